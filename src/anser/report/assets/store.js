/* Flights of the page: unpacked variables, and the state shared by all views. */
"use strict";

/** A run: variables are unpacked at first use, an array for each aircraft. */
class Run {
  constructor({ packed, ...data }, colors) {
    Object.assign(this, data);
    const rows = 1 + Object.keys(data.variables).length * data.aircraft.length; // the variables, and time
    this.bytes = inflate(Uint8Array.from(atob(packed), (c) => c.charCodeAt(0)), 4 * data.times * rows);
    this.cache = new Map();
    this.time = this._unpack(0, 1, data.timeStep, [])[0];
    this.end = this.time[this.times - 1];
    this.aircraft.forEach((one, k) => {
      Object.assign(one, { index: k, hue: colors.get(one.name) });
      Object.defineProperty(one, "color", { get: () => Theme.ink(one.hue) });
    });
  }

  /** Values of a variable: a Float64Array for each aircraft, NaN in gaps; null if the run lacks the variable. */
  values(name) {
    const variable = this.variables[name];
    if (!variable) return null;
    if (!this.cache.has(name)) {
      const before = this.times * (1 + (variable.place - 1) * this.aircraft.length);
      this.cache.set(name, this._unpack(before, this.aircraft.length, variable.step, variable.gaps));
    }
    return this.cache.get(name);
  }

  _unpack(before, count, step, gaps) {
    const total = count * this.times, start = 4 * before, bytes = this.bytes, found = [];
    for (let k = 0; k < count; k++) {
      const values = new Float64Array(this.times);
      let value = 0, slope = 0;
      for (let j = 0; j < this.times; j++) {
        const at = start + k * this.times + j;
        const zigzag = (bytes[at] | (bytes[at + total] << 8) | (bytes[at + 2 * total] << 16) | (bytes[at + 3 * total] << 24)) >>> 0;
        slope += zigzag % 2 ? -(zigzag + 1) / 2 : zigzag / 2;
        value += slope;
        values[j] = value * step;
      }
      found.push(values);
    }
    for (const [k, first, last] of gaps) found[k].fill(NaN, first, last + 1);
    return found;
  }

  /** Index of the last record at or before a time, and the fraction of the interval to the next, 0 to 1. */
  locate(time) {
    const times = this.time;
    let low = 0, high = this.times - 1;
    if (time >= times[high]) return [high, 0];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle;
      else high = middle;
    }
    return [low, Math.min(1, Math.max(0, (time - times[low]) / (times[high] - times[low])))];
  }

  /** Value of an aircraft's variable at a time, interpolated linearly between records. */
  at(name, k, time) {
    const values = this.values(name);
    if (!values) return NaN;
    const [low, part] = this.locate(time);
    const here = values[k][low];
    if (part === 0) return here;
    const next = values[k][low + 1];
    // no interpolation across a wrapped angle or into a gap
    if (!Number.isFinite(next) || (this.variables[name].unit === "°" && Math.abs(next - here) > 180)) return here;
    return here + part * (next - here);
  }

  /** Name of an aircraft's goal at a time; a takeover of another goal changes it. */
  goalAt(k, time) {
    return this.aircraft[k].goals.findLast(([, from]) => time >= from || from === 0)[0];
  }

  /** Index of an aircraft by name, or -1. */
  indexOf(name) {
    return this.aircraft.findIndex((one) => one.name === name);
  }
}

/** Current time, aircraft in focus and visible aircraft; every view listens to changes. */
class State {
  constructor(runs) {
    this.runs = runs;
    this.end = Math.max(1e-3, ...runs.map((run) => run.end)); // a single record has no duration
    this.time = 0;
    this.playing = false;
    this.rate = 1;
    this.names = [...new Set(runs.flatMap((run) => run.aircraft.map((one) => one.name)))];
    this.focus = this.names[0];
    this.hidden = new Set();
    this.listeners = { time: [], focus: [], shown: [], playing: [] };
  }

  on(what, listener) {
    this.listeners[what].push(listener);
  }

  _tell(what) {
    this.listeners[what].forEach((listener) => listener(this));
  }

  setTime(time) {
    this.time = Math.min(this.end, Math.max(0, time));
    this._tell("time");
  }

  setFocus(name) {
    this.focus = name;
    this.hidden.delete(name);
    this._tell("shown");
    this._tell("focus");
  }

  toggle(name, shown) {
    if (shown) this.hidden.delete(name);
    else this.hidden.add(name);
    this._tell("shown");
  }

  setPlaying(playing) {
    if (playing === this.playing) return;
    this.playing = playing;
    if (playing && this.time >= this.end) this.setTime(0);
    this._tell("playing");
    let last = performance.now();
    const step = (now) => {
      if (!this.playing) return;
      this.setTime(this.time + (this.rate * Math.min(200, now - last)) / 1000);
      last = now;
      if (this.time >= this.end) this.setPlaying(false);
      else requestAnimationFrame(step);
    };
    if (playing) requestAnimationFrame(step);
  }
}

const FORMATS = []; // a format by the number of decimals: making one takes longer than its use

/** Number as text with a fixed number of decimals; by default about four significant digits. */
function printed(value, decimals) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const digits = decimals ?? (size >= 1000 ? 0 : size >= 100 ? 1 : size >= 1 ? 2 : 3);
  const text = (FORMATS[digits] ??= new Intl.NumberFormat("en-US", { minimumFractionDigits: digits, maximumFractionDigits: digits })).format(value);
  return /[1-9]/.test(text) ? text.replace("-", "−") : text.replace("-", "");
}

/** Element with a class and text; the text is never interpreted as HTML. */
function element(tag, className = "", text = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text) made.textContent = text;
  return made;
}
