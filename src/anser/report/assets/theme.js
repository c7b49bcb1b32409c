/* Colours of the style sheet in the light scheme, the dark scheme and print, for drawing on canvases. */
"use strict";

const FONT = "system-ui, sans-serif";

const Theme = {
  inks: new Map(),
  listeners: [],
  printing: false,

  /** Current colour of a variable of the style sheet: "#rrggbb", or "rgba(...)" if transparent. */
  ink(name) {
    if (!this.inks.has(name)) {
      if (!this.probe) document.body.append((this.probe = document.createElement("i")));
      this.probe.hidden = true;
      this.probe.style.color = `var(--${name})`;
      const found = getComputedStyle(this.probe).color, parts = found.match(/[\d.]+/g).map(Number);
      this.inks.set(name, parts.length > 3 ? found : `#${parts.map((part) => part.toString(16).padStart(2, "0")).join("")}`);
    }
    return this.inks.get(name);
  },

  /** Register a function that redraws immediately when the colours change or the page is printed. */
  on(listener) {
    this.listeners.push(listener);
  },

  /** A printed page is light and has a fixed width: both are applied before printing. */
  print(begins) {
    this.printing = begins;
    document.documentElement.classList.toggle("printing", begins);
    this.tell();
  },

  tell() {
    this.inks.clear();
    this.listeners.forEach((listener) => listener());
  },
};

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (!Theme.printing) Theme.tell(); });
addEventListener("beforeprint", () => Theme.print(true));
addEventListener("afterprint", () => Theme.print(false));

/** Options common to all plots; a printed plot is drawn at twice the size and halved by the style sheet, to be sharp. */
function plotLook({ axes, series, ...options }) {
  const k = Theme.printing ? 2 : 1, font = `${11 * k}px ${FONT}`;
  const look = {
    stroke: Theme.ink("quiet"), grid: { stroke: Theme.ink("grid"), width: k }, ticks: { stroke: Theme.ink("line"), width: k, size: 4 * k },
    font, labelFont: font, labelSize: 16 * k, labelGap: 0, gap: 4 * k,
  };
  const wide = (u, ticks) => k * Math.max(44, 14 + 6.6 * Math.max(0, ...(ticks || []).map((one) => one.length)));
  return {
    padding: [8 * k, 18 * k, 0, 0], legend: { show: false }, ...options,
    width: k * options.width, height: k * options.height,
    cursor: { y: false, drag: { x: false, y: false }, points: { show: false }, ...options.cursor },
    series: series.map((one) => ({ ...one, pxAlign: 0, width: k * (one.width ?? 1), dash: one.dash?.map((part) => k * part) })),
    axes: [{ ...look, space: 50 * k, size: 24 * k, ...axes[0] }, { ...look, space: 30 * k, size: wide, ...axes[1] }],
  };
}
