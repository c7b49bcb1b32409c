/* Plots of a campaign: convergence, distributions, outputs against each input. */
"use strict";

const TALL = 230;
const WHOLE = Array.from({ length: 9 }, (_, k) => [1, 2, 5].map((one) => one * 10 ** k)).flat(); // steps of a count

/** Text of a tick, with enough decimals to differ from the next tick, one step away. */
const ticked = (value, step) =>
  value.toLocaleString("en-US", { maximumFractionDigits: Math.min(12, Math.max(0, Math.ceil(-Math.log10(step)) + 1)) }).replace("-", "−");

/** Distance of the ticks of an axis, pixels: the width of the text and a gap. */
const tickSpace = (u, axis, low, high) =>
  (Theme.printing ? 2 : 1) * (16 + 6.6 * Math.max(...[low, high].map((end) => ticked(end, (high - low) / 5).length)));

/** Canvas pixels per page pixel; a printed canvas is drawn at twice the size. */
const canvasScale = () => (devicePixelRatio || 1) * (Theme.printing ? 2 : 1);

/** Name of a quantity with its unit, if any. */
const named = (words, unit) => (unit ? `${words} (${unit})` : words);

/** Whether numbers are equal except for rounding. */
function alike(values) {
  const known = values.filter((value) => value !== null), low = Math.min(...known), high = Math.max(...known);
  return known.length > 1 && high - low <= 1e-8 * Math.max(Math.abs(low), Math.abs(high));
}

/** Range of numbers with a margin; null is ignored. */
function reach(values, room = 0.05) {
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (value === null) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (!(low <= high)) return [0, 1];
  const more = high - low > 1e-8 * Math.max(Math.abs(low), Math.abs(high)) ? room * (high - low) : Math.max(room * Math.abs(high), 1e-6);
  return [low - more, high + more];
}

/** A figure with a caption, drawn when scrolled into view, and again after a change of the window's width. */
class Chart {
  constructor(place, title) {
    this.root = element("figure", "plot");
    const head = element("figcaption");
    this.title = element("span", "title", title);
    this.readout = element("output", "readout");
    head.append(this.title, this.readout);
    this.box = element("div", "canvas");
    this.root.append(head, this.box);
    this.root.chart = this;
    place.append(this.root);
    Chart.watch.observe(this.root);
    Chart.all.push(this);
  }

  draw() {
    if (this.plot) this.plot.destroy();
    const { options, data } = this.described();
    const spread = (axis) => ({ values: (u, ticks, at, space, step) => ticks.map((tick) => ticked(tick, step)), ...axis });
    this.plot = new uPlot(
      plotLook({ width: Math.max(220, this.box.clientWidth), height: TALL, ...options, axes: [0, 1].map((n) => spread({ ...(n ? {} : { space: tickSpace }), ...options.axes?.[n] })) }),
      data,
      this.box
    );
    this.stale = false;
  }
}
Chart.all = [];
Chart.visible = new Set();
Chart.watch = new IntersectionObserver((entries) => entries.forEach((entry) => {
  const chart = entry.target.chart;
  if (!entry.isIntersecting) { Chart.visible.delete(chart); return; }
  Chart.visible.add(chart);
  if (!chart.plot || chart.stale) chart.draw();
}), { rootMargin: "200px" });

/** Redraw the visible charts now, the remaining charts when scrolled into view. */
function refresh(charts = Chart.all) {
  charts.forEach((chart) => { chart.stale = true; });
  charts.filter((chart) => Chart.visible.has(chart)).forEach((chart) => chart.draw());
}

/** An estimate with its confidence interval against the number of flights. */
class Converging extends Chart {
  constructor(place, title, lines, unit) {
    super(place, title);
    Object.assign(this, { lines, unit });
  }

  described() {
    const { n, value, low, high } = this.lines, thin = { stroke: Theme.ink("band"), width: 1, points: { show: false } };
    // a band needs two numbers: an open interval extends to the edge of the plot
    const known = value.filter((_, k) => k >= n.length / 20), range = reach([...known, ...low.slice(-60), ...high.slice(-60)]);
    const filled = (ends, edge) => ends.map((end, k) => end ?? (value[k] === null ? null : edge)), beyond = range[1] - range[0];
    const lows = filled(low, range[0] - beyond), highs = filled(high, range[1] + beyond);
    return {
      options: {
        scales: { x: { time: false }, y: { range: () => range } },
        series: [{}, thin, thin, { stroke: Theme.ink("c0"), width: 2, points: { show: n.length < 3 } }],
        bands: [{ series: [2, 1], fill: Theme.ink("band") }],
        axes: [{ label: "flights", incrs: WHOLE }],
        hooks: { setCursor: [(u) => this._tell(u)] },
      },
      data: [n, lows, highs, value],
    };
  }

  _tell(u) {
    const k = u.cursor.idx, { n, value, low, high } = this.lines;
    if (k === null || k === undefined) { this.readout.textContent = ""; return; }
    this.readout.textContent = `${n[k].toLocaleString("en-US")}: ${printed(value[k] ?? NaN)} (${printed(low[k] ?? NaN)} to ${printed(high[k] ?? NaN)}) ${this.unit}`;
  }
}

/** A variable over time: median over the flights and band around it, for each aircraft. */
class Bands extends Chart {
  constructor(place, one, colors) {
    super(place, named(one.words, one.unit));
    Object.assign(this, { one, colors });
  }

  described() {
    const { time, aircraft } = this.one, edge = { width: 0, points: { show: false } };
    const color = (k) => Theme.ink(`c${k % this.colors}`);
    const range = reach(aircraft.flatMap((each) => [...each.low, ...each.high]));
    return {
      options: {
        scales: { x: { time: false }, y: { range: () => range } },
        series: [{}, ...aircraft.flatMap((_, k) => [edge, edge, { stroke: color(k), width: 2, points: { show: time.length < 3 } }])],
        bands: aircraft.map((_, k) => ({ series: [3 * k + 2, 3 * k + 1], fill: `${color(k)}29` })),
        axes: [{ label: "time (s)" }],
        hooks: { setCursor: [(u) => this._tell(u)] },
      },
      data: [time, ...aircraft.flatMap(({ low, high, middle }) => [low, high, middle])],
    };
  }

  _tell(u) {
    const k = u.cursor.idx, { time, aircraft } = this.one;
    if (k === null || k === undefined) { this.readout.textContent = ""; return; }
    const told = aircraft.map(({ name, low, middle, high }) => `${name} ${printed(middle[k] ?? NaN)} (${printed(low[k] ?? NaN)} to ${printed(high[k] ?? NaN)})`);
    this.readout.textContent = `${printed(time[k])} s: ${told.join(", ")}`;
  }
}

/** Share of the flights within each bound, with the confidence intervals of the quantiles. */
class Distribution extends Chart {
  constructor(place, quantity) {
    super(place, named(quantity.words, quantity.unit));
    this.quantity = quantity;
  }

  draw() {
    const { kept, unit } = this.quantity;
    if (!alike(kept)) return super.draw();
    const words = `The same in all ${kept.length.toLocaleString("en-US")} flights that have it: ${+kept[0].toPrecision(6)} ${unit}`;
    this.box.replaceChildren(element("p", "alike", words.trim()));
    this.plot = null;
    this.stale = false;
  }

  described() {
    const { kept, part, upper, quantiles } = this.quantity;
    const ends = quantiles.flatMap((one) => [one.low, one.high, one.value]);
    const range = reach([...kept, ...ends]);
    return {
      options: {
        scales: { x: { time: false, range: () => range }, y: { range: () => [0, 103] } },
        series: [{}, { stroke: Theme.ink("c0"), width: 2, paths: uPlot.paths.stepped({ align: upper ? 1 : -1 }), points: { show: kept.length < 3 } }],
        axes: [{ label: upper ? "at most" : "at least" }, { values: (u, ticks) => ticks.map((one) => `${one} %`) }],
        hooks: { draw: [(u) => this._marks(u)], setCursor: [(u) => this._tell(u)] },
      },
      data: [kept, part],
    };
  }

  _marks(u) {
    const { ctx, bbox } = u, ratio = canvasScale();
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.strokeStyle = ctx.fillStyle = Theme.ink("c1");
    for (const { share, value, low, high } of this.quantity.quantiles) {
      if (value === null) continue;
      const y = u.valToPos(100 * share, "y", true), x = u.valToPos(value, "x", true);
      const from = low === null ? bbox.left : u.valToPos(low, "x", true);
      const to = high === null ? bbox.left + bbox.width : u.valToPos(high, "x", true);
      ctx.lineWidth = 3 * ratio;
      ctx.beginPath();
      ctx.moveTo(from, y);
      ctx.lineTo(to, y);
      ctx.stroke();
      ctx.beginPath();
      ctx.arc(x, y, 3.5 * ratio, 0, 2 * Math.PI);
      ctx.fill();
    }
    ctx.restore();
  }

  _tell(u) {
    const k = u.cursor.idx, { kept, part, unit } = this.quantity;
    this.readout.textContent = k === null || k === undefined || kept[k] === undefined ? "" : `${printed(part[k])} %: ${printed(kept[k])} ${unit}`;
  }
}

/** The flights against one input: dots met every requirement, crosses did not. */
class Against extends Chart {
  constructor(place, data, input, chosen) {
    super(place, "");
    Object.assign(this, { campaign: data, input, chosen });
  }

  /** Position of a flight on the input's axis: text values side by side, with random scatter. */
  _x(k) {
    const value = this.input.values[k];
    return this.input.levels ? value + 0.5 * ((this.campaign.numbers[k] * 0.618034) % 1) - 0.25 : value;
  }

  described() {
    const { levels, values } = this.input, quantity = this.chosen();
    this.title.textContent = named(quantity.words, quantity.unit);
    const x = levels ? [-0.6, levels.length - 0.4] : reach(values, 0.03), y = reach(this.campaign.outputs[quantity.name], 0.08);
    const texts = levels && { splits: () => levels.map((_, k) => k), values: (u, ticks) => ticks.map((k) => levels[k]) };
    return {
      options: {
        scales: { x: { time: false, range: () => x }, y: { range: () => y } },
        series: [{}, { paths: () => null, points: { show: false } }],
        axes: [{ label: this.input.path, ...(texts || {}) }],
        cursor: { x: false, y: false, drag: { x: false, y: false }, points: { show: false } },
        hooks: { draw: [(u) => this._dots(u, quantity)], setCursor: [(u) => this._tell(u, quantity)] },
      },
      data: [x, [null, null]],
    };
  }

  /** Position of a flight in the plot, pixels; at the edge if the value is missing. */
  _at(u, k, quantity, canvas) {
    const y = this.campaign.outputs[quantity.name][k], edge = quantity.upper ? 0.02 : 0.98;
    const tall = canvas ? u.bbox.height : u.over.clientHeight, top = canvas ? u.bbox.top : 0;
    return [u.valToPos(this._x(k), "x", canvas), y === null ? top + edge * tall : u.valToPos(y, "y", canvas)];
  }

  _dots(u, quantity) {
    const { ctx } = u, ratio = canvasScale(), { failed, numbers } = this.campaign, many = numbers.length > 1000;
    ctx.save();
    ctx.fillStyle = Theme.ink("c0");
    ctx.globalAlpha = many ? 0.45 : 0.75;
    const size = (many ? 1.6 : 2.4) * ratio;
    numbers.forEach((_, k) => {
      if (failed[k]) return;
      const [x, y] = this._at(u, k, quantity, true);
      ctx.beginPath();
      ctx.arc(x, y, size, 0, 2 * Math.PI);
      ctx.fill();
    });
    ctx.globalAlpha = 0.9;
    ctx.strokeStyle = Theme.ink("c1");
    ctx.lineWidth = 1.6 * ratio;
    const arm = 3.4 * ratio;
    ctx.beginPath();
    numbers.forEach((_, k) => {
      if (!failed[k]) return;
      const [x, y] = this._at(u, k, quantity, true);
      ctx.moveTo(x - arm, y - arm);
      ctx.lineTo(x + arm, y + arm);
      ctx.moveTo(x - arm, y + arm);
      ctx.lineTo(x + arm, y - arm);
    });
    ctx.stroke();
    ctx.restore();
  }

  /** Flight nearest to the mouse pointer. */
  _tell(u, quantity) {
    const { left, top } = u.cursor;
    let best = -1, least = 14 ** 2;
    if (left >= 0) {
      this.campaign.numbers.forEach((_, k) => {
        const [x, y] = this._at(u, k, quantity, false), off = (x - left) ** 2 + (y - top) ** 2;
        if (off < least) [best, least] = [k, off];
      });
    }
    const y = best < 0 ? null : this.campaign.outputs[quantity.name][best];
    this.readout.textContent = best < 0 ? "" : `flight ${this.campaign.numbers[best]}: ${y === null ? "no number" : `${printed(y)} ${quantity.unit}`}`;
  }
}

/** A row in the table of the worst flights highlights its tracks on the map. */
function linkMap() {
  const map = document.querySelector(".map");
  if (!map) return;
  document.querySelectorAll("#worst tr[data-flight]").forEach((row) => {
    const track = map.querySelector(`.worst-track[data-flight="${row.dataset.flight}"]`);
    if (!track) return;
    row.addEventListener("mouseenter", () => { map.classList.add("focused"); track.classList.add("chosen"); });
    row.addEventListener("mouseleave", () => { map.classList.remove("focused"); track.classList.remove("chosen"); });
  });
}

function start() {
  const data = JSON.parse(document.getElementById("campaign").textContent);
  const place = (name) => document.querySelector(`[data-plots="${name}"]`);
  if (data.met.n.length) new Converging(place("converging"), "met every requirement (%)", data.met, "%");
  for (const one of data.quantities) {
    const title = named(`${one.words} that ${+(100 * one.share).toPrecision(4)} % of the flights keep`, one.unit);
    if (one.converging.value.some((value) => value !== null)) new Converging(place("converging"), title, one.converging, one.unit);
    new Distribution(place("distributions"), one);
  }
  for (const one of data.series) new Bands(place("series"), one, data.colors);
  const select = document.getElementById("quantity");
  if (select && data.quantities.length) {
    for (const one of data.quantities) {
      const option = element("option", "", named(one.words, one.unit));
      option.value = one.name;
      select.append(option);
    }
    const chosen = () => data.quantities.find((one) => one.name === select.value);
    const charts = data.inputs.map((input) => new Against(place("against"), data, input, chosen));
    select.addEventListener("change", () => refresh(charts));
    const [drawn, all] = data.drawn;
    if (drawn < all) document.getElementById("drawn").textContent = `${drawn.toLocaleString("en-US")} of ${all.toLocaleString("en-US")} flights are drawn, failed ones closer together.`;
  }
  linkMap();
  Theme.on(() => (Theme.printing ? Chart.all.forEach((chart) => chart.draw()) : refresh()));
  let width = innerWidth;
  addEventListener("resize", () => {
    if (innerWidth === width) return;
    width = innerWidth;
    refresh();
  });
  window.anser = { data, charts: Chart.all };
  document.documentElement.dataset.ready = String(Math.round(performance.now()));
}

try {
  start();
} catch (error) {
  console.error(error);
  document.getElementById("fault").hidden = false;
  document.getElementById("fault").textContent = `The interactive part of this page could not start: ${error.message}`;
}
