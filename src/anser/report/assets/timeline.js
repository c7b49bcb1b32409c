/* Lanes of events over time: phase of the flight, renewals of the plan, commands at a limit. */
"use strict";

const RENEWAL_INKS = ["#57606a", "#0072B2", "#D55E00", "#1b1f24", "#CC79A7", "#56B4E9"];
const PHASE_INKS = { approach: "#d7e7f3", frozen: "#9cc3de", hold: "#edeff2" };
const LIMITED_INK = "#E69F00", OUTSIDE_INK = "#b3261e";

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
    this.names = Math.min(150, 24 + 7 * Math.max(...run.aircraft.map((one) => Math.min(18, one.name.length))));
    this.canvas.addEventListener("mousemove", (event) => this._over(event));
    this.canvas.addEventListener("click", (event) => {
      const one = run.aircraft[Math.floor(event.offsetY / this.lane)];
      if (one) state.setFocus(one.name);
    });
    for (const what of ["time", "focus", "shown"]) state.on(what, () => this.draw());
    addEventListener("resize", () => this.draw());
  }

  _x(time) {
    const [from, to] = [0, this.state.end];
    return this.names + ((time - from) / (to - from)) * (this.width - this.names - 16);
  }

  _over(event) {
    const time = ((event.offsetX - this.names) / (this.width - this.names - 16)) * this.state.end;
    if (!this.state.playing && time >= 0) this.state.setTime(time);
    const k = Math.floor(event.offsetY / this.lane), one = this.run.aircraft[k];
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
    const { run, state, canvas } = this, ratio = devicePixelRatio || 1, lane = this.lane;
    this.width = this.root.clientWidth;
    if (!this.width) return;
    const height = lane * run.aircraft.length + 22;
    canvas.width = this.width * ratio;
    canvas.height = height * ratio;
    canvas.style.width = `${this.width}px`;
    canvas.style.height = `${height}px`;
    const ctx = canvas.getContext("2d");
    ctx.scale(ratio, ratio);
    ctx.font = "12px system-ui, sans-serif";
    ctx.textBaseline = "middle";
    run.aircraft.forEach((one, k) => this._lane(ctx, one, k));
    ctx.fillStyle = "#57606a";
    ctx.textAlign = "center";
    const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600].find((s) => state.end / s <= this.width / 90) || 7200;
    for (let t = 0; t <= state.end + 1e-9; t += step) ctx.fillText(`${t.toLocaleString("en-US")}${t === 0 ? " s" : ""}`, this._x(t), height - 9);
    ctx.strokeStyle = "#1b1f24";
    ctx.beginPath();
    ctx.moveTo(this._x(state.time), 0);
    ctx.lineTo(this._x(state.time), height - 18);
    ctx.stroke();
  }

  _lane(ctx, one, k) {
    const { run, state, lane } = this, events = run.events[k], top = k * lane, band = lane - 6;
    ctx.globalAlpha = state.hidden.has(one.name) ? 0.3 : 1;
    const bar = (from, to, ink, y, size) => {
      ctx.fillStyle = ink;
      ctx.fillRect(this._x(from), y, Math.max(1, this._x(to) - this._x(from)), size);
    };
    for (const [name, from, to] of events.phases) bar(from, to, PHASE_INKS[name] || "#dddddd", top + 3, band);
    for (const [, from, to] of events.limited) bar(from, to, LIMITED_INK, top + 3 + band - 5, 5);
    for (const [from, to] of events.outside) bar(from, to, OUTSIDE_INK, top + 3, 4);
    for (const [code, from, to] of events.failed) if (code) bar(from, to, "#5c1a16", top + 3 + band / 2 - 1, 3);
    for (const [time, what] of events.renewals) {
      ctx.fillStyle = RENEWAL_INKS[what];
      const wide = what >= 2;
      ctx.fillRect(this._x(time) - (wide ? 1.25 : 0.5), top + 3, wide ? 2.5 : 1, wide ? band : band / 2);
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
    ctx.fillStyle = "#1b1f24";
    ctx.textAlign = "left";
    ctx.font = `${one.name === state.focus ? "600 " : ""}12px system-ui, sans-serif`;
    ctx.fillText(one.name.length > 18 ? `${one.name.slice(0, 17)}…` : one.name, 16, top + lane / 2 + 0.5);
    ctx.globalAlpha = 1;
  }
}
