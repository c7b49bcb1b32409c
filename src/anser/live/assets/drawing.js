/* Drawing with SVG elements that stay between two drawings, and handles for pointer and keyboard. */
"use strict";

const RAW_MS = 4, SVG = "http://www.w3.org/2000/svg";
const SHAPES = {
  dart: "M11 0L-8 8L-4 0L-8 -8Z", square: "M-6 -6H6V6H-6Z", diamond: "M0 -7L7 0L0 7L-7 0Z", cross: "M-7 0H7M0 -7V7", arrow: "M7 0L-5 6V-6Z",
  dot: "M-5 0a5 5 0 1 0 10 0a5 5 0 1 0 -10 0Z",
};

/** Elements of a layer by key: one that is not drawn again is removed. */
class Layer {
  constructor(parent, className) {
    this.root = parent.appendChild(document.createElementNS(SVG, "g"));
    this.root.setAttribute("class", className);
    this.parts = new Map();
    this.drawn = new Set();
  }

  part(key, tag, attributes, text) {
    let made = this.parts.get(key);
    if (made?.tagName !== tag) {
      made?.remove();
      made = this.root.appendChild(document.createElementNS(SVG, tag));
      this.parts.set(key, made);
    }
    for (const [name, value] of Object.entries(attributes)) if (made.getAttribute(name) !== String(value)) made.setAttribute(name, value);
    if (text !== undefined && made.textContent !== text) made.textContent = text;
    this.drawn.add(key);
    return made;
  }

  end() {
    for (const [key, made] of this.parts) {
      if (this.drawn.has(key)) continue;
      made.remove();
      this.parts.delete(key);
    }
    this.drawn.clear();
  }
}

const pixel = (value) => value.toFixed(1);

/** Path data of a line through points in pixels; a break at a missing point. */
function linePath(xs, ys) {
  let path = "", pen = "M";
  for (let j = 0; j < xs.length; j++) {
    if (!Number.isFinite(xs[j] + ys[j])) { pen = "M"; continue; }
    path += `${pen}${pixel(xs[j])} ${pixel(ys[j])}`;
    pen = "L";
  }
  return path;
}

/** Least round number (1, 2, 5, 10, ...) that is not below a value. */
function roundUp(value) {
  const scale = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((factor) => factor * scale).find((number) => number >= 0.999 * value);
}

const roundTo = (value, step) => Number((Math.round(value / step) * step).toFixed(6));
const radians = (angle_deg) => (angle_deg * Math.PI) / 180, degrees = (angle) => (angle * 180) / Math.PI;
const compassOf = (north, east) => (Math.round((Math.atan2(east, north) * 180) / Math.PI) + 360) % 360;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/**
 * Handles of a picture. A handle has a key, a label, a position (x, y; pixels), a shape, and the functions `drag(x, y)`
 * and `nudge(right, up)`; `slider` holds least, greatest and present value of a handle with one degree of freedom, `area`
 * the radius (pixels) of a disc that is dragged as a whole, `select` list and index of the table that the key Delete removes.
 */
class Handles {
  constructor(svg, page) {
    Object.assign(this, { svg, page, held: null, moved: 0 });
    this.layer = new Layer(svg, "handles");
    this.definitions = new Map();
    const root = this.layer.root;
    root.addEventListener("pointerdown", (event) => this._press(event));
    root.addEventListener("pointermove", (event) => this._move(event));
    // raw updates precede the frame for which moves are gathered: the plan is asked for earlier
    root.addEventListener("pointerrawupdate", (event) => { if (event.timeStamp - this.moved >= RAW_MS) this._move(event); });
    for (const type of ["pointerup", "pointercancel", "lostpointercapture"]) root.addEventListener(type, (event) => this._release(event));
    root.addEventListener("keydown", (event) => this._key(event));
  }

  show(definitions) {
    this.definitions = new Map(definitions.map((one) => [one.key, one]));
    for (const one of definitions) {
      const { key, label, x, y, shape, color = "var(--goal)", turn = 0, slider } = one;
      const about = slider ? { role: "slider", "aria-valuemin": slider.min, "aria-valuemax": slider.max, "aria-valuenow": slider.now, "aria-valuetext": slider.text }
        : { role: "button", "aria-roledescription": "movable point" };
      const made = this.layer.part(key, "g", { class: `handle ${one.className || ""}`, tabindex: 0, "data-key": key, "aria-label": label, transform: `translate(${pixel(x)} ${pixel(y)})`, ...about });
      made.style.color = color;
      if (!made.firstChild) {
        for (const className of ["reach", "mark"]) made.appendChild(document.createElementNS(SVG, "path")).setAttribute("class", className);
      }
      const reach = pixel(Math.max(13, one.area || 0));
      if (made.dataset.reach !== reach) made.firstChild.setAttribute("d", `M-${reach} 0a${reach} ${reach} 0 1 0 ${2 * reach} 0a${reach} ${reach} 0 1 0 -${2 * reach} 0Z`);
      made.dataset.reach = reach;
      made.lastChild.setAttribute("d", SHAPES[shape]);
      made.lastChild.setAttribute("transform", `rotate(${turn})`);
    }
    this.layer.end();
  }

  _of(event) {
    return this.definitions.get(event.target.closest("[data-key]")?.dataset.key);
  }

  _at(event) {
    const bounds = this.svg.getBoundingClientRect();
    return [event.clientX - bounds.left, event.clientY - bounds.top];
  }

  _press(event) {
    const one = this._of(event);
    if (!one || event.button || this.page.fixed) return;
    event.stopPropagation();
    const [x, y] = this._at(event);
    this.held = { key: one.key, id: event.pointerId, dx: one.x - x, dy: one.y - y };
    event.target.closest("[data-key]").focus({ preventScroll: true });
    this.layer.root.setPointerCapture(event.pointerId);
    event.preventDefault();
  }

  _move(event) {
    if (!this.held || event.pointerId !== this.held.id) return;
    const [x, y] = this._at(event);
    this.moved = event.timeStamp;
    this.definitions.get(this.held.key)?.drag(x + this.held.dx, y + this.held.dy, { held: true, merge: this.held.key, stamp: event.timeStamp });
    this.held.moved = true;
  }

  _release(event) {
    if (!this.held || event.pointerId !== this.held.id) return;
    const { moved } = this.held;
    this.held = null;
    if (moved) this.page.released();
  }

  _key(event) {
    const one = this._of(event), arrow = ARROWS[event.key];
    if (event.key === "Delete" && one && !event.repeat) {
      event.target.blur(); // the handle with this number is that of the next one afterwards
      this.page.remove(one.select);
      return;
    }
    if (!one || !arrow || this.page.fixed || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const factor = event.shiftKey ? 10 : 1;
    one.nudge(factor * arrow[0], factor * arrow[1], { merge: one.key, stamp: event.timeStamp });
  }
}
