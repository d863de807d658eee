// The legend in the corner of the map, the bar that shows its scale, and the place under the pointer.

import { h } from "./dom.js";
import { distance, latitude, longitude } from "./format.js";

const BAR_PX = 120;
const ROUND = [1, 2, 5];

export function drawLegend(element, legend) {
  const content = [h("b", {}, legend.title)];
  if (legend.items) {
    for (const item of legend.items) {
      content.push(h("span", { class: "item" }, glyph(item.name, item.colour), item.text));
    }
  } else {
    content.push(h("div", { class: "ramp", style: { background: `linear-gradient(to right, ${legend.colours.join(",")})` } }));
    content.push(h("div", { class: "ticks" }, legend.ticks.map((tick) => h("span", { style: { left: `${tick.at * 100}%` } }, tick.text))));
  }
  element.replaceChildren(...content);
}

// A symbol as on the map.
function glyph(name, colour) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "-1 -1 2 2");
  svg.setAttribute("width", "14");
  svg.setAttribute("height", "14");
  const shape = document.createElementNS("http://www.w3.org/2000/svg", "path");
  const paths = {
    fused: "M-.72 0a.72.72 0 1 0 1.44 0a.72.72 0 1 0-1.44 0z", adsb: "M0-.95L.7.75L0 .45L-.7.75z",
    radar: "M-.62-.62h1.24v1.24h-1.24z", coasted: "M-.6 0a.6.6 0 1 0 1.2 0a.6.6 0 1 0-1.2 0z",
    suspect: "M0-.8L.8 0L0 .8L-.8 0zM-.4-.4L.4.4M-.4.4L.4-.4",
  };
  shape.setAttribute("d", paths[name]);
  const hollow = name === "coasted" || name === "suspect";
  shape.setAttribute("fill", hollow ? "none" : colour);
  shape.setAttribute("stroke", hollow ? colour : "none");
  shape.setAttribute("stroke-width", "0.3");
  svg.append(shape);
  return svg;
}

// A bar of a round length, about as long as BAR_PX.
export function drawScale(element, view, settings) {
  const unit = settings.units === "metric" ? 1000 : 1852;
  const most = (view.metresPerPixel * BAR_PX) / unit;
  const power = 10 ** Math.floor(Math.log10(most));
  const length = (ROUND.findLast((k) => k * power <= most) ?? 1) * power;
  const text = length * unit < 1000 && settings.units === "metric" ? `${(length * unit).toFixed(0)} m` : `${Number(length.toPrecision(1))} ${settings.units === "metric" ? "km" : "NM"}`;
  element.replaceChildren(text, h("i", { style: { width: `${(length * unit) / view.metresPerPixel}px` } }));
}

export function drawCursor(element, place, from, settings, inverse) {
  if (!place) {
    element.textContent = "";
    return;
  }
  let text = `${latitude(place.lat)} ${longitude(place.lon)}`;
  if (from) {
    const { distance: d, bearing } = inverse(from.lat, from.lon, place.lat, place.lon);
    text += `  ${bearing.toFixed(0).padStart(3, "0")}° ${distance(d, settings)} from ${from.name}`;
  }
  element.textContent = text;
}
