// Controls bound to a setting: each shows it, changes it, and follows when it changes elsewhere.

import { h } from "./dom.js";

export function checkbox(settings, name, text) {
  return h("label", { class: "check" },
    h("input", { type: "checkbox", checked: settings[name], "data-key": name, onchange: (event) => settings.set({ [name]: event.target.checked }) }), text);
}

// `options`: pairs of value and text.
export function choice(settings, name, text, options) {
  const usual = typeof settings[name] === "number";
  const select = h("select", {
    "data-key": name,
    onchange: (event) => settings.set({ [name]: usual ? Number(event.target.value) : event.target.value }),
  }, options.map(([value, words]) => h("option", { value: String(value), selected: String(value) === String(settings[name]) }, words)));
  return h("label", { class: "field" }, text, select);
}

// A field of text, or of a number where `limits` are given.
export function entry(settings, name, text, { limits = null, placeholder = "" } = {}) {
  return h("label", { class: "field" }, text, bare(settings, name, { limits, placeholder, label: text }));
}

export function bare(settings, name, { limits = null, placeholder = "", label = "" } = {}) {
  const number = typeof settings[name] === "number";
  return h("input", {
    type: limits ? "number" : "text", value: String(settings[name]), placeholder, "data-key": name, "aria-label": label,
    ...(limits ? { min: String(limits[0]), max: String(limits[1]) } : { maxLength: 60 }),
    oninput: (event) => {
      const value = number ? Number(event.target.value) : event.target.value;
      if (!number || (event.target.value !== "" && Number.isFinite(value) && value >= limits[0] && value <= limits[1])) settings.set({ [name]: value });
    },
  });
}

// Take over what changed elsewhere, without disturbing the field that is being written in.
export function syncFields(element, settings) {
  for (const field of element.querySelectorAll("[data-key]")) {
    const name = field.dataset.key;
    if (field === document.activeElement || !(name in settings)) continue;
    if (field.type === "checkbox") field.checked = settings[name];
    else if ("value" in field && field.tagName !== "BUTTON") field.value = String(settings[name]);
  }
}
