// Elements of the page made in one line: `h("button", {class: "x", onclick: f}, "text")`. Text is never read as HTML.

export function h(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "style") Object.assign(element.style, value);
    else if (name === "class") element.className = value;
    else if (name in element && !name.startsWith("aria")) element[name] = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export function byId(id) {
  return document.getElementById(id);
}

// Pairs of a name and a value, the value text or elements; a pair without value is left out.
export function facts(pairs) {
  const list = h("dl", { class: "facts" });
  for (const [name, value] of pairs) {
    if (value === null || value === undefined || value === "") continue;
    list.append(h("dt", {}, name), h("dd", {}, value));
  }
  return list;
}

// The head of a panel with its button to close it.
export function panelHead(title, close) {
  return h("h2", {}, title, h("button", { class: "close", type: "button", "aria-label": `Close ${title}`, onclick: close }, "Close"));
}

let pressed = null; // what the pointer is held down on
document.addEventListener("pointerdown", (event) => (pressed = event.target), true);
for (const end of ["pointerup", "pointercancel"]) document.addEventListener(end, () => setTimeout(() => (pressed = null)), true);

// Whether the user is about to click something in an element, or has marked text in it.
function inHand(element) {
  const marked = getSelection();
  return (pressed && element.contains(pressed)) || (marked && !marked.isCollapsed && element.contains(marked.anchorNode));
}

// Replace what an element holds, keeping the focus where it was if that part is still there (by data-key). What the user
// has in hand stays as it is until the next time.
export function refill(element, ...children) {
  if (inHand(element)) return;
  const key = document.activeElement && element.contains(document.activeElement) ? document.activeElement.dataset.key : null;
  const scroll = element.scrollTop;
  element.replaceChildren(...children.flat());
  element.scrollTop = scroll;
  if (key) element.querySelector(`[data-key="${CSS.escape(key)}"]`)?.focus({ preventScroll: true });
}

// Fit a canvas to its box on the screen; returns its 2D context and size in CSS pixels.
export function fitCanvas(canvas) {
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}
