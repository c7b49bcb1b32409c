/* Plots over time that share one instant, drawn when they come into sight. */
"use strict";

const FEW = 4; // so many aircraft are all drawn in their colours, with their commands
const QUIET = "#c3cad3", LIMIT_INK = "#b3261e", AXIS_INK = "#57606a", GRID_INK = "#eceff2";

/** Values as uPlot takes them: null where there is none. */
function drawable(values) {
  return values.some(Number.isNaN) ? Array.from(values, (value) => (Number.isNaN(value) ? null : value)) : values;
}

/** Angles without their jumps by a full turn, so that a line can be drawn; those of a command stay by the response. */
function unwound(values, response) {
  const found = Float64Array.from(values);
  let turns = response ? 360 * Math.round((response.find(Number.isFinite) - values.find(Number.isFinite)) / 360) || 0 : 0;
  let last = NaN;
  for (let j = 0; j < values.length; j++) {
    if (Math.abs(values[j] - last) > 180) turns -= 360 * Math.sign(values[j] - last);
    if (Number.isFinite(values[j])) last = values[j];
    found[j] = values[j] + turns;
  }
  return found;
}

class Plot {
  constructor(run, panel, state, group) {
    Object.assign(this, { run, panel, state, group });
    this.root = element("figure", "plot");
    const label = run.variables[panel.response];
    const head = element("figcaption");
    this.title = element("span", "title", label.words + " ");
    const symbol = element("span", "symbol");
    symbol.innerHTML = label.symbol; // escaped where it was made
    this.title.append(symbol, label.unit ? ` (${label.unit})` : "");
    this.readout = element("output", "readout");
    head.append(this.title, this.readout);
    this.box = element("div", "canvas");
    this.root.append(head, this.box);
    this.unit = label.unit;
    this.responses = run.values(panel.response);
    this.commands = panel.command ? run.values(panel.command) : null;
    if (this.unit === "°") {
      this.responses = this.responses.map((values) => unwound(values));
      this.commands = this.commands && this.commands.map((values, k) => unwound(values, this.responses[k]));
    }
  }

  /** Least and greatest value within the time that is shown; limits too where the panel asks for them. */
  _range() {
    const focus = this.run.indexOf(this.state.focus), key = `${focus} ${this.group.window}`;
    if (this.spanOf === key) return this.span;
    const [from, to] = this.group.window.map((time) => this.run.locate(time)[0]);
    const ends = (rows) => {
      let low = Infinity, high = -Infinity;
      for (const row of rows) {
        for (let j = from; j <= Math.min(to + 1, row.length - 1); j++) {
          if (row[j] < low) low = row[j];
          if (row[j] > high) high = row[j];
        }
      }
      return [low, high];
    };
    const all = this.run.aircraft.length <= FEW;
    let [low, high] = ends(this.responses);
    const [least, most] = ends((this.commands || []).filter((_, k) => all || k === focus));
    // a command may lie far beyond what can be done: the response must stay legible
    const reach = high - low > 1e-9 ? high - low : Infinity;
    low = Math.min(low, Math.max(least, low - reach));
    high = Math.max(high, Math.min(most, high + reach));
    if (this.panel.within) {
      low = Math.min(low, ...this.panel.limits);
      high = Math.max(high, ...this.panel.limits);
    }
    if (!(low <= high)) [low, high] = [0, 1];
    const room = high - low > 1e-9 ? 0.05 * (high - low) : Math.max(0.05 * Math.abs(high), 0.5);
    this.span = [low - room, high + room];
    this.spanOf = key;
    return this.span;
  }

  _series() {
    const { run, state } = this, list = [], data = [run.time];
    const focus = run.indexOf(state.focus), few = run.aircraft.length <= FEW;
    const order = run.aircraft.map((_, k) => k).filter((k) => k !== focus);
    if (focus >= 0) order.push(focus);
    for (const k of order) {
      const one = run.aircraft[k];
      if (state.hidden.has(one.name)) continue;
      const stroke = few || k === focus ? one.color : QUIET;
      list.push({ stroke, width: k === focus ? 2.2 : few ? 1.4 : 0.9, points: { show: false } });
      data.push(drawable(this.responses[k]));
      if (this.commands && (few || k === focus)) {
        const ink = k === focus ? "#1b1f24" : one.color;
        list.push({ stroke: ink, width: 1.1, dash: [5, 4], points: { show: false } });
        data.push(drawable(this.commands[k]));
      }
    }
    return [list, data];
  }

  draw() {
    const width = Math.max(220, this.box.clientWidth), height = 190, [list, data] = this._series();
    if (this.plot) this.plot.destroy();
    const axis = { stroke: AXIS_INK, grid: { stroke: GRID_INK, width: 1 }, ticks: { stroke: "#c8ced6", width: 1, size: 4 }, font: "11px system-ui, sans-serif" };
    const shared = this.group;
    this.plot = new uPlot(
      {
        width, height, padding: [6, 18, 0, 0], legend: { show: false },
        scales: {
          x: { time: false, range: () => shared.window },
          y: { range: (u, low, high, key) => shared.rangeOf(this) },
        },
        series: [{}, ...list],
        axes: [
          { ...axis, size: 28, gap: 3, values: (u, ticks) => ticks.map((t) => t.toLocaleString("en-US")) },
          { ...axis, size: (u, ticks) => Math.max(48, 14 + 6.6 * Math.max(0, ...(ticks || []).map((t) => t.length))), gap: 4, values: (u, ticks) => ticks.map((t) => +t.toPrecision(6)).map((t) => t.toLocaleString("en-US", { maximumFractionDigits: 6 }).replace("-", "−")) },
        ],
        cursor: { y: false, drag: { x: true, y: false }, points: { show: false } },
        select: { show: true },
        hooks: {
          draw: [(u) => this._marks(u)],
          setSelect: [(u) => {
            if (u.select.width < 6) return;
            const from = u.posToVal(u.select.left, "x"), to = u.posToVal(u.select.left + u.select.width, "x");
            u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
            shared.zoom([from, to]);
          }],
        },
      },
      data,
      this.box
    );
    const over = this.plot.over;
    over.addEventListener("mousemove", () => {
      if (!this.state.playing && this.plot.cursor.left >= 0) this.state.setTime(this.plot.posToVal(this.plot.cursor.left, "x"));
    });
    over.addEventListener("dblclick", () => shared.zoom([0, this.state.end]));
    over.addEventListener("click", () => this.state.setPlaying(false));
    this.stale = false;
    queueMicrotask(() => this.point()); // uPlot knows its scales only after its own microtask
  }

  /** Limits, the arrivals, the renewals of the aircraft in focus. */
  _marks(u) {
    const { ctx, bbox } = u, k = this.run.indexOf(this.state.focus), ratio = devicePixelRatio || 1;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = Math.max(1, Math.round(ratio));
    ctx.strokeStyle = LIMIT_INK;
    for (const limit of this.panel.limits) {
      const y = Math.round(u.valToPos(limit, "y", true)) + (ctx.lineWidth % 2) / 2; // on whole pixels: sharp
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    const arrival = k >= 0 ? this.run.aircraft[k].arrival_s : null;
    if (arrival !== null) {
      const x = u.valToPos(arrival, "x", true);
      ctx.lineWidth = ratio;
      ctx.strokeStyle = "#8c959f";
      ctx.setLineDash([2 * ratio, 3 * ratio]);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.setLineDash([]);
    }
    if (k >= 0) {
      const bottom = bbox.top + bbox.height;
      for (const [time, what] of this.run.events[k].renewals) {
        const x = u.valToPos(time, "x", true);
        ctx.lineWidth = (what >= 2 ? 2 : 1) * ratio;
        ctx.strokeStyle = RENEWAL_INKS[what];
        ctx.beginPath();
        ctx.moveTo(x, bottom);
        ctx.lineTo(x, bottom - (what >= 2 ? 12 : 5) * ratio);
        ctx.stroke();
      }
    }
    ctx.restore();
  }

  /** Move the cursor to the shared instant and print the values there. */
  point() {
    const { run, state } = this, k = run.indexOf(state.focus);
    if (this.plot) {
      const left = this.plot.valToPos(state.time, "x");
      const inside = left >= 0 && left <= this.plot.over.clientWidth;
      this.plot.setCursor({ left: inside ? left : -10, top: inside ? 5 : -10 }, false);
    }
    if (k < 0) {
      this.readout.textContent = "";
      return;
    }
    const now = printed(run.at(this.panel.response, k, state.time));
    const wanted = this.commands ? printed(run.at(this.panel.command, k, state.time)) : "";
    this.readout.textContent = wanted ? `${now} / ${wanted}` : now;
    this.readout.style.color = run.aircraft[k].color;
  }
}

/** All plots of the page: one time axis, one range for the same variable of two runs. */
class Plots {
  constructor(state) {
    this.state = state;
    this.window = [0, state.end];
    this.list = [];
    this.visible = new Set();
    this.watch = new IntersectionObserver((entries) => entries.forEach((entry) => this._seen(entry)), { rootMargin: "120px" });
    state.on("time", () => this.visible.forEach((plot) => plot.point()));
    for (const what of ["focus", "shown"]) state.on(what, () => this.refresh());
    let width = innerWidth;
    addEventListener("resize", () => {
      if (innerWidth === width) return;
      width = innerWidth;
      this.refresh();
    });
  }

  add(plot) {
    plot.stale = true;
    this.list.push(plot);
    plot.root.plot = plot;
    this.watch.observe(plot.root);
  }

  rangeOf(plot) {
    const same = this.list.filter((one) => one.panel.response === plot.panel.response && one.panel.command === plot.panel.command && one.panel.within === plot.panel.within);
    const spans = same.map((one) => one._range());
    return [Math.min(...spans.map((s) => s[0])), Math.max(...spans.map((s) => s[1]))];
  }

  zoom(span) {
    this.window = span;
    this.refresh();
  }

  refresh() {
    this.list.forEach((plot) => { plot.stale = true; });
    this.visible.forEach((plot) => plot.draw());
  }

  _seen(entry) {
    const plot = entry.target.plot;
    if (!entry.isIntersecting) {
      this.visible.delete(plot);
      return;
    }
    this.visible.add(plot);
    if (plot.stale) plot.draw();
    else plot.point();
  }
}
