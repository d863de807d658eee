// Keys that work wherever the focus is, except in a field that takes text.

export const KEYS = [
  ["/", "search"], ["n  p", "next, previous aircraft in view"], ["Esc", "close, then deselect"],
  ["e", "elements of the selected aircraft"], ["o", "follow it"], ["i", "isolate it"],
  ["arrows", "move the map"], ["+  −", "zoom"], ["0", "show all traffic"], ["m", "measure from the map's centre or the selected aircraft"],
  ["t", "table"], ["s", "sensors"], ["f", "filters"], ["d", "display"], ["?", "this help"],
  ["l", "labels: none, short, full"], ["v", "speed vector: none, 1, 2, 5 min"], ["h", "trails: by number, none, selected, all"],
  ["c", "colour: source, altitude, accuracy, age"], ["g", "grid"], ["r", "range rings"], ["x", "dark or light"],
  ["space", "replay: play or pause"], [",  .", "replay: back, on by 10 s"],
];

export function listenToKeys(actions) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const field = event.target.closest?.("input, select, textarea");
    if (field && event.key !== "Escape") return;
    if (event.key === " " && event.target.closest?.("button, summary, a, tr")) return;
    const action = actions[event.key];
    if (action && action() !== false) event.preventDefault();
  });
}
