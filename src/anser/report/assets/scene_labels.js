/* Names in a scene, moved vertically to avoid overlaps. */
"use strict";

const LABEL_TALL = 16, LABEL_TRIES = 7;

class Labels {
  constructor(root) {
    this.root = root;
    this.made = new Map();
  }

  /** Show exactly these names, { name, place, color, side } each: above their positions (side -1) or below (1). */
  place(named, eye) {
    const taken = [], shown = new Set();
    for (const { name, place, color, side } of named) {
      const { x, y, seen } = eye.pixelsOf(place);
      if (!seen) continue;
      const label = this._label(side, name, color);
      shown.add(label);
      label.root.hidden = false;
      label.wide ||= label.root.offsetWidth;
      let at = y + side * 17;
      const lies = () => taken.some((other) => Math.abs(other.y - at) < LABEL_TALL && Math.abs(other.x - x) < 0.5 * (other.wide + label.wide));
      for (let turn = 0; turn < LABEL_TRIES && lies(); turn++) at += side * LABEL_TALL;
      taken.push({ x, y: at, wide: label.wide });
      label.root.style.transform = `translate(${x.toFixed(1)}px, ${at.toFixed(1)}px) translate(-50%, -50%)`;
    }
    this.made.forEach((label) => { if (!shown.has(label)) label.root.hidden = true; });
  }

  _label(side, name, color) {
    const key = `${side} ${name}`;
    if (!this.made.has(key)) {
      const root = element("span", side > 0 ? "label of-goal" : "label"), swatch = color ? element("span", "swatch") : "";
      root.append(swatch, name);
      this.root.append(root);
      this.made.set(key, { root, swatch });
    }
    const label = this.made.get(key);
    if (color) label.swatch.style.background = color;
    return label;
  }
}
