/* Lanes of events over time: phases of the flight, replanning, limited commands. */
"use strict";

const RENEWALS = ["quiet", "c0", "c1", "ink", "c3", "c5"], PHASES = ["approach", "frozen", "hold"];
const MARKED = 2; // replanning outcomes from this code on are rare and marked individually
const LIMIT_TALL = 12;

/** Colours of the replanning outcomes, in the order of `anser.report.derived_variables.REPLANNING_OUTCOMES`. */
const renewalInks = () => RENEWALS.map((name) => Theme.ink(name));

/** Frequent replanning events merged to what is distinguishable at a scale: [from, to, outcome]. */
function closeTogether(renewals, x, gap = 4) {
  const found = [];
  for (const [time, what] of renewals) {
    if (what >= MARKED) continue;
    const at = x(time), last = found.at(-1);
    if (last && last[2] === what && at - last[1] < gap) last[1] = at;
    else found.push([at, at, what]);
  }
  return found;
}

class Timeline {
  constructor(run, state, group) {
    Object.assign(this, { run, state, group });
    this.root = element("div", "timeline");
    this.canvas = element("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", "Events of each aircraft over time");
    this.told = element("output", "told");
    this.root.append(this.canvas, this.told);
    this.lane = run.aircraft.length > 8 ? 20 : 30;
    this.names = Math.min(150, 24 + 7 * Math.max(...run.aircraft.map((one) => Math.min(18, one.name.length)), ...this._rowNames()));
    this.canvas.addEventListener("mousemove", (event) => this._over(event));
    this.canvas.addEventListener("click", (event) => {
      const one = run.aircraft[this._laneAt(event.offsetY)];
      if (one) state.setFocus(one.name);
    });
    for (const what of ["time", "focus", "shown"]) state.on(what, () => this.draw());
    addEventListener("resize", () => this.draw());
    Theme.on(() => this.draw());
  }

  /** Limited commands of an aircraft, a row for each; in a large fleet only for the aircraft in focus. */
  _limits(k) {
    const { run, state } = this;
    if (run.aircraft.length > 8 && run.aircraft[k].name !== state.focus) return [];
    return [...new Set(run.events[k].limited.map(([what]) => what))].sort();
  }

  /** Lengths of the labels of limited commands, in letters of the names, which are larger. */
  _rowNames() {
    const { events, eventWords } = this.run;
    return events.flatMap((one) => one.limited.map(([what]) => 0.8 * eventWords.limited[what].length));
  }

  /** Vertical start of each aircraft's lane, and the end of the last lane; pixels. */
  _tops() {
    const tops = [0];
    this.run.aircraft.forEach((_, k) => tops.push(tops[k] + this.lane + LIMIT_TALL * this._limits(k).length));
    return tops;
  }

  _laneAt(y) {
    return this._tops().findLastIndex((top) => top <= y);
  }

  _x(time) {
    const [from, to] = [0, this.state.end];
    return this.names + ((time - from) / (to - from)) * (this.width - this.names - 16);
  }

  _over(event) {
    const time = ((event.offsetX - this.names) / (this.width - this.names - 16)) * this.state.end;
    if (!this.state.playing && time >= 0) this.state.setTime(time);
    const k = this._laneAt(event.offsetY), one = this.run.aircraft[k];
    this.told.textContent = one ? this._words(k, Math.max(0, time)) : "";
  }

  _words(k, time) {
    const events = this.run.events[k], { renewals, limited } = this.run.eventWords;
    const phase = events.phases.find(([, from, to]) => time >= from && time <= to);
    const held = events.limited.filter(([, from, to]) => time >= from && time <= to).map(([what]) => limited[what]);
    const last = events.renewals.filter(([at]) => at <= time).at(-1);
    const parts = [`${this.run.aircraft[k].name}, ${printed(time)} s: ${phase ? phase[0] : "–"}`];
    if (last) parts.push(`plan last changed at ${printed(last[0])} s, ${renewals[last[1]]}`);
    if (held.length) parts.push(`at a limit: ${held.join(", ")}`);
    if (events.outside.some(([from, to]) => time >= from && time <= to)) parts.push("outside the aerodynamic tables");
    return parts.join("; ");
  }

  draw() {
    const { run, state, canvas } = this, ratio = Theme.printing ? 2 : devicePixelRatio || 1, tops = this._tops();
    this.width = this.root.clientWidth;
    if (!this.width) return;
    const height = tops.at(-1) + 38;
    canvas.width = this.width * ratio;
    canvas.height = height * ratio;
    canvas.style.width = `${this.width}px`;
    canvas.style.height = `${height}px`;
    const ctx = canvas.getContext("2d");
    ctx.scale(ratio, ratio);
    ctx.font = `12px ${FONT}`;
    ctx.textBaseline = "middle";
    run.aircraft.forEach((one, k) => this._lane(ctx, one, k, tops[k]));
    ctx.fillStyle = Theme.ink("quiet");
    ctx.textAlign = "center";
    const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600].find((s) => state.end / s <= this.width / 90) || 7200;
    for (let t = 0; t <= state.end + 1e-9; t += step) ctx.fillText(t.toLocaleString("en-US"), this._x(t), height - 26);
    ctx.fillText("time (s)", 0.5 * (this._x(0) + this._x(state.end)), height - 9);
    if (Theme.printing) return; // a printed page has no time cursor
    ctx.strokeStyle = Theme.ink("ink");
    ctx.beginPath();
    ctx.moveTo(this._x(state.time), 0);
    ctx.lineTo(this._x(state.time), height - 34);
    ctx.stroke();
  }

  _lane(ctx, one, k, top) {
    const { run, state, lane } = this, events = run.events[k], band = lane - 6;
    ctx.globalAlpha = state.hidden.has(one.name) ? 0.3 : 1;
    const bar = (from, to, ink, y, size) => {
      ctx.fillStyle = ink;
      ctx.fillRect(this._x(from), y, Math.max(1, this._x(to) - this._x(from)), size);
    };
    for (const [name, from, to] of events.phases) bar(from, to, Theme.ink(PHASES.includes(name) ? name : "line"), top + 3, band);
    const rows = this._limits(k), edge = top + lane;
    if (!rows.length) for (const [, from, to] of events.limited) bar(from, to, Theme.ink("near"), top + 3 + band - 5, 5);
    for (const [what, from, to] of rows.length ? events.limited : []) bar(from, to, Theme.ink("near"), edge + LIMIT_TALL * rows.indexOf(what) + 2, 7);
    for (const [from, to] of events.outside) bar(from, to, Theme.ink("limit"), top + 3, 4);
    for (const [code, from, to] of events.failed) if (code) bar(from, to, Theme.ink("failed"), top + 3 + band / 2 - 1, 3);
    for (const [from, to, what] of closeTogether(events.renewals, (time) => this._x(time))) {
      ctx.fillStyle = ctx.strokeStyle = Theme.ink(RENEWALS[what]);
      if (to > from) ctx.strokeRect(from, top + 4.5, to - from, 4);
      else ctx.fillRect(from - 0.5, top + 3, 1, band / 2);
    }
    for (const [time, what] of events.renewals.filter(([, what]) => what >= MARKED)) {
      ctx.fillStyle = Theme.ink(RENEWALS[what]);
      ctx.fillRect(this._x(time) - 1.25, top + 3, 2.5, band);
    }
    if (one.arrival_s !== null) {
      const x = this._x(one.arrival_s), y = top + lane / 2;
      ctx.fillStyle = one.color;
      ctx.beginPath();
      ctx.moveTo(x, y - 6);
      ctx.lineTo(x + 5, y);
      ctx.lineTo(x, y + 6);
      ctx.lineTo(x - 5, y);
      ctx.fill();
    }
    ctx.fillStyle = one.color;
    ctx.fillRect(0, top + lane / 2 - 5, 10, 10);
    ctx.fillStyle = Theme.ink("quiet");
    ctx.textAlign = "right";
    ctx.font = `11px ${FONT}`;
    rows.forEach((what, row) => ctx.fillText(run.eventWords.limited[what], this.names - 6, edge + LIMIT_TALL * row + 6));
    ctx.fillStyle = Theme.ink("ink");
    ctx.textAlign = "left";
    ctx.font = `${one.name === state.focus ? "600 " : ""}12px ${FONT}`;
    ctx.fillText(one.name.length > 18 ? `${one.name.slice(0, 17)}…` : one.name, 16, top + lane / 2 + 0.5);
    ctx.globalAlpha = 1;
  }
}
