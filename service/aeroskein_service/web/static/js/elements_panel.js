// Placeholder until the element view follows.
export class ElementsPanel {
  constructor(element, { settings }) { this._element = element; this._settings = settings; }
  settings() { this._element.hidden = this._settings.view !== "elements" || !this._settings.primary; }
  frame() {}
  numbers() { return null; }
}
