/* Plots over time with a common time cursor, drawn when scrolled into view. */
"use strict";

const FEW = 4; // a fleet up to this size is drawn in colours, with the commands
const PLOT_TALL = 204, PRINTED_TALL = 168, TURN_STEPS = [1, 2, 5, 10, 15, 30, 45, 90, 120, 180, 360, 720, 1080, 1440, 1800, 3600];

/** Values for uPlot: null for a missing value. */
function drawable(values) {
  return values.some(Number.isNaN) ? Array.from(values, (value) => (Number.isNaN(value) ? null : value)) : values;
}

/** Unwrap angles, so that a line can be drawn; a command is unwrapped to stay close to the response. */
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

/** Angle as on a compass, from 0 to 360 degrees. */
const onCompass = (value) => ((value % 360) + 360) % 360;

class Plot {
  constructor(run, panel, state, group) {
    Object.assign(this, { run, panel, state, group });
    this.root = element("figure", "plot");
    const label = run.variables[panel.response];
    const head = element("figcaption");
    this.title = element("span", "title", label.words);
    const symbol = element("span", "symbol"), axis = element("span", "axis-title");
    symbol.innerHTML = label.symbol; // escaped by the report
    axis.append(symbol, label.unit ? ` (${label.unit})` : "");
    this.swatch = element("span", "swatch");
    this.readout = element("output", "readout");
    head.append(this.title, this.swatch, this.readout);
    this.box = element("div", "canvas");
    this.root.append(head, this.box, axis);
    this.unit = label.unit;
    this.responses = run.values(panel.response);
    this.commands = panel.command ? run.values(panel.command) : null;
    this.bands = panel.band ? panel.band.map((name) => run.values(name)) : null; // lower and upper ends
    if (this.unit === "°") {
      this.responses = this.responses.map((values) => unwound(values));
      this.commands = this.commands && this.commands.map((values, k) => unwound(values, this.responses[k]));
    }
  }

  /** Range of the values within the visible time; includes limits if the panel requests it. */
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
    const beside = [...(this.commands ? [this.commands] : []), ...(this.bands || [])];
    const [least, most] = ends(beside.flatMap((rows) => rows.filter((_, k) => all || k === focus)));
    // a command or a band may be far beyond the response, which must stay legible
    const size = this.bands ? 0.1 * Math.max(Math.abs(low), Math.abs(high)) : 0;
    const reach = high - low > 1e-9 ? Math.max(high - low, size) : Infinity;
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
    const { run, state } = this, list = [], data = [run.time], bands = [];
    const focus = run.indexOf(state.focus), few = run.aircraft.length <= FEW;
    const order = run.aircraft.map((_, k) => k).filter((k) => k !== focus);
    if (focus >= 0) order.push(focus);
    for (const k of order) {
      const one = run.aircraft[k];
      if (state.hidden.has(one.name)) continue;
      const stroke = few || k === focus ? one.color : Theme.ink("others");
      list.push({ stroke, width: k === focus ? 2.2 : few ? 1.4 : 0.9, points: { show: false } });
      data.push(drawable(this.responses[k]));
      if (this.commands && (few || k === focus)) {
        const ink = k === focus ? Theme.ink("ink") : one.color;
        list.push({ stroke: ink, width: 1.1, dash: [5, 4], points: { show: false } });
        data.push(drawable(this.commands[k]));
      }
      if (this.bands && (few || k === focus)) {
        for (const rows of this.bands) {
          list.push({ stroke, width: 0.5, points: { show: false } });
          data.push(drawable(rows[k]));
        }
        bands.push({ series: [data.length - 1, data.length - 2], fill: `${one.color}2e` });
      }
    }
    return [list, data, bands];
  }

  draw() {
    const width = Math.max(220, this.box.clientWidth), [list, data, bands] = this._series(), shared = this.group;
    if (this.plot) this.plot.destroy();
    const ticked = (tick) => (+(this.panel.compass ? onCompass(tick) : tick).toPrecision(6)).toLocaleString("en-US", { maximumFractionDigits: 6 }).replace("-", "−");
    this.plot = new uPlot(
      plotLook({
        width, height: Theme.printing ? PRINTED_TALL : PLOT_TALL,
        scales: {
          x: { time: false, range: () => shared.window },
          y: { range: (u, low, high, key) => shared.rangeOf(this) },
        },
        series: [{}, ...list],
        bands,
        axes: [
          { label: "time (s)", values: (u, ticks) => ticks.map((t) => t.toLocaleString("en-US")) },
          { values: (u, ticks) => ticks.map(ticked), ...(this.panel.compass && { incrs: TURN_STEPS }) },
        ],
        cursor: { drag: { x: true, y: false } },
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
      }),
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

  /** Draw limits, arrivals, and replanning events of the aircraft in focus. */
  _marks(u) {
    const { ctx, bbox } = u, k = this.run.indexOf(this.state.focus), ratio = (devicePixelRatio || 1) * (Theme.printing ? 2 : 1);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = Math.max(1, Math.round(ratio));
    ctx.strokeStyle = Theme.ink("limit");
    for (const limit of this.panel.limits) {
      const y = Math.round(u.valToPos(limit, "y", true)) + (ctx.lineWidth % 2) / 2; // on whole pixels, for sharp lines
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    const arrival = k >= 0 ? this.run.aircraft[k].arrival_s : null;
    if (arrival !== null) {
      const x = u.valToPos(arrival, "x", true);
      ctx.lineWidth = ratio;
      ctx.strokeStyle = Theme.ink("quiet");
      ctx.setLineDash([2 * ratio, 3 * ratio]);
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.setLineDash([]);
    }
    if (k >= 0) {
      const bottom = bbox.top + bbox.height;
      const { renewals } = this.run.events[k], x = (time) => u.valToPos(time, "x", true), inks = renewalInks();
      for (const [from, to, what] of closeTogether(renewals, x, 4 * ratio)) {
        ctx.fillStyle = inks[what];
        if (to > from) ctx.fillRect(from, bottom - 2 * ratio, to - from, 1.5 * ratio);
        else ctx.fillRect(from - 0.5 * ratio, bottom - 5 * ratio, ratio, 5 * ratio);
      }
      for (const [time, what] of renewals.filter(([, what]) => what >= MARKED)) {
        ctx.fillStyle = inks[what];
        ctx.fillRect(x(time) - ratio, bottom - 12 * ratio, 2 * ratio, 12 * ratio);
      }
    }
    ctx.restore();
  }

  /** Move the cursor to the common time and print the values. */
  point() {
    const { run, state } = this, k = run.indexOf(state.focus);
    if (this.plot) {
      const left = this.plot.valToPos(state.time, "x");
      const inside = left >= 0 && left <= this.plot.over.clientWidth;
      this.plot.setCursor({ left: inside ? left : -10, top: inside ? 5 : -10 }, false);
    }
    this.swatch.hidden = k < 0;
    if (k < 0) {
      this.readout.textContent = "";
      return;
    }
    const told = (name) => {
      const value = run.at(name, k, state.time);
      return printed(this.panel.compass ? onCompass(value) : value);
    };
    this.readout.textContent = this.commands ? `${told(this.panel.response)} / ${told(this.panel.command)}` : told(this.panel.response);
    this.swatch.style.background = `var(--${run.aircraft[k].hue})`;
  }
}

/** All plots of the page: a common time axis, a common range of a variable in two runs. */
class Plots {
  constructor(state) {
    this.state = state;
    this.window = [0, state.end];
    this.list = [];
    this.visible = new Set();
    this.watch = new IntersectionObserver((entries) => entries.forEach((entry) => this._seen(entry)), { rootMargin: "120px" });
    state.on("time", () => this.visible.forEach((plot) => plot.point()));
    for (const what of ["focus", "shown"]) state.on(what, () => this.refresh());
    Theme.on(() => this.refresh());
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
    (Theme.printing ? this.list : this.visible).forEach((plot) => plot.draw());
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
