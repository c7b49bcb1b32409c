/* Builds the page: scenes, time controls, list of aircraft, plots, timelines. */
"use strict";

function buildScenes(runs, state, plots) {
  const frame = frameOf(runs), options = { plans: true }, scenes = [];
  document.querySelectorAll(".scene-place").forEach((place) => {
    const run = runs[Number(place.dataset.run)];
    try {
      const scene = new FlightScene(run, state, frame, options, liftOf(frame.box));
      place.append(scene.root);
      scenes.push(scene);
    } catch (error) {
      place.append(element("p", "lacking", `No 3-D scene: this browser offers no WebGL (${error.message}).`));
    }
  });
  scenes.forEach((scene) => { scene.peers = scenes.filter((one) => one !== scene); });
  const views = document.querySelectorAll("[data-view]");
  views.forEach((button) => button.addEventListener("click", () => {
    views.forEach((one) => one.setAttribute("aria-pressed", String(one === button)));
    state.leading = null;
    scenes.forEach((scene) => scene.look(button.dataset.view));
  }));
  const lift = document.getElementById("lift");
  lift.value = String(liftOf(frame.box));
  lift.addEventListener("change", () => scenes.forEach((scene) => scene.setLift(Number(lift.value))));
  document.getElementById("plans").addEventListener("change", (event) => {
    options.plans = event.target.checked;
    scenes.forEach((scene) => scene.update());
  });
  return scenes;
}

function buildTransport(state, runs) {
  const button = document.getElementById("play"), slider = document.getElementById("time"), told = document.getElementById("told");
  const rate = document.getElementById("rate"), focus = document.getElementById("focus");
  slider.max = String(state.end);
  slider.step = "any";
  slider.addEventListener("input", () => state.setTime(Number(slider.value)));
  button.addEventListener("click", () => state.setPlaying(!state.playing));
  rate.addEventListener("change", () => { state.rate = Number(rate.value); });
  state.rate = Number(rate.value);
  for (const name of state.names) {
    const option = element("option", "", name);
    option.value = name;
    focus.append(option);
  }
  focus.addEventListener("change", () => state.setFocus(focus.value));
  const show = () => {
    slider.value = String(state.time);
    told.textContent = `${state.time.toFixed(1)} of ${state.end.toFixed(0)} s`;
  };
  state.on("time", show);
  state.on("focus", () => { focus.value = state.focus; });
  state.on("playing", () => {
    button.firstChild.textContent = state.playing ? "❚❚" : "▶";
    button.title = state.playing ? "Pause" : "Play";
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== " " || /^(INPUT|SELECT|BUTTON|SUMMARY|A)$/.test(event.target.tagName)) return;
    event.preventDefault();
    state.setPlaying(!state.playing);
  });
  const marks = document.getElementById("marks");
  const times = new Set(runs.flatMap((run) => run.aircraft.map((one) => one.arrival_s)).filter((t) => t !== null).map((t) => t.toFixed(1)));
  times.forEach((time) => {
    const mark = element("i");
    mark.style.left = `${(100 * Number(time)) / state.end}%`;
    mark.title = `arrival at ${time} s`;
    marks.append(mark);
  });
  show();
}

/** List of aircraft with their current values; a click focuses an aircraft, a check box shows or hides it. */
function buildList(place, run, state) {
  const table = element("table"), head = element("tr"), body = element("tbody"), cells = [];
  const columns = [["altitude_m", "Height", "m"], ["airspeed_m_s", "Speed", "m/s"], ["bank_deg", "Bank", "°"], ["range_to_rendezvous_m", "To go", "m"]];
  head.append(element("th", "text", "Aircraft"));
  for (const [, words, unit] of columns) {
    const cell = element("th", "", words);
    cell.append(element("small", "", unit));
    head.append(cell);
  }
  const top = element("thead");
  top.append(head);
  table.append(top, body);
  for (const one of run.aircraft) {
    const row = element("tr"), name = element("td", "text name"), box = element("input"), button = element("button", "", one.name);
    box.type = "checkbox";
    box.checked = true;
    box.title = "show";
    box.setAttribute("aria-label", `show ${one.name}`);
    box.addEventListener("change", () => state.toggle(one.name, box.checked));
    button.type = "button";
    button.title = `to ${one.goal}`;
    button.addEventListener("click", () => state.setFocus(one.name));
    const swatch = element("span", "swatch");
    swatch.style.background = `var(--${one.hue})`;
    name.append(box, swatch, button);
    row.append(name);
    const numbers = columns.map(() => row.appendChild(element("td")));
    cells.push({ one, row, box, numbers });
    body.append(row);
  }
  place.append(table);
  const focused = () => cells.forEach(({ one, row, box }) => {
    row.className = one.name === state.focus ? "chosen" : "";
    box.checked = !state.hidden.has(one.name);
  });
  const show = () => cells.forEach(({ one, numbers }) => numbers.forEach((cell, c) => {
    cell.textContent = printed(run.at(columns[c][0], one.index, state.time), 0);
  }));
  state.on("time", show);
  state.on("focus", focused);
  state.on("shown", focused);
  focused();
  show();
}

/** Colour legend: the whole of a small fleet, or the aircraft in focus of a large one. */
function buildKeys(runs, state) {
  const few = runs.every((run) => run.aircraft.length <= FEW);
  const color = (name) => `var(--${runs.flatMap((run) => run.aircraft).find((one) => one.name === name).hue})`;
  const entry = (name) => {
    const button = element("button", name === state.focus ? "chosen" : ""), swatch = element("span", "swatch");
    swatch.style.background = color(name); // a CSS variable: follows the light or dark scheme
    button.type = "button";
    button.append(swatch, name);
    button.addEventListener("click", () => state.setFocus(name));
    return button;
  };
  const fill = () => document.querySelectorAll(".who").forEach((place) => {
    place.replaceChildren(...(few ? state.names : [state.focus]).map(entry));
    if (!few) place.append(element("span", "", "grey: the others"));
  });
  state.on("focus", fill);
  fill();
}

function buildPlots(runs, state) {
  const plots = new Plots(state);
  document.querySelectorAll(".plots").forEach((grid) => {
    const found = runs.map((run) => run.sections.find((section) => section.key === grid.dataset.section)?.panels ?? []);
    const keys = [...new Set(found.flat().map((panel) => panel.response))];
    for (const key of keys) {
      runs.forEach((run, r) => {
        const panel = found[r].find((one) => one.response === key);
        if (!panel) {
          grid.append(element("p", "lacking", "not in this run"));
          return;
        }
        const plot = new Plot(run, panel, state, plots);
        grid.append(plot.root);
        plots.add(plot);
      });
    }
  });
  document.querySelectorAll("[data-zoom]").forEach((button) => button.addEventListener("click", () => {
    const arrivals = runs.flatMap((run) => run.aircraft.map((one) => one.arrival_s)).filter((t) => t !== null);
    const last = arrivals.length ? Math.max(...arrivals) : state.end;
    const spans = { all: [0, state.end], approach: [0, last], last: [Math.max(0, last - 15), Math.min(state.end, last + 5)] };
    plots.zoom(spans[button.dataset.zoom]);
  }));
  return plots;
}

function start() {
  const data = JSON.parse(document.getElementById("flights").textContent);
  const names = [...new Set(data.runs.flatMap((run) => run.aircraft.map((one) => one.name)))];
  const colors = new Map(names.map((name, k) => [name, `c${k % data.colors}`]));
  const runs = data.runs.map((run) => new Run(run, colors));
  const state = new State(runs), plots = buildPlots(runs, state), scenes = buildScenes(runs, state, plots);
  document.querySelectorAll(".list-place").forEach((place) => buildList(place, runs[Number(place.dataset.run)], state));
  document.querySelectorAll(".timeline-place").forEach((place) => {
    const timeline = new Timeline(runs[Number(place.dataset.run)], state, plots);
    place.append(timeline.root);
    timeline.draw();
  });
  buildTransport(state, runs);
  buildKeys(runs, state);
  const arrivals = runs[0].aircraft.map((one) => one.arrival_s).filter((t) => t !== null);
  state.setTime(arrivals.length ? Math.max(...arrivals) * 0.6 : 0);
  state.setFocus(state.focus);
  window.anser = { state, runs, scenes, plots };
  document.documentElement.dataset.ready = String(Math.round(performance.now()));
}

try {
  start();
} catch (error) {
  console.error(error);
  document.getElementById("fault").hidden = false;
  document.getElementById("fault").textContent = `The interactive part of this page could not start: ${error.message}`;
}
