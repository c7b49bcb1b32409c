/* Builds the page: scenes, time controls, list of aircraft, plots, timelines. */
"use strict";

/** Bounding box of the tracks of all runs, km, and the centre (north, east; m) of the scenes. */
function frameOf(runs) {
  const ends = [Infinity, -Infinity, Infinity, -Infinity, 0, -Infinity];
  for (const run of runs) {
    ["north", "east", "altitude"].forEach((axis, a) => {
      for (const prefix of ["", "rendezvous_"]) {
        for (const row of run.values(`${prefix}${axis}_m`)) {
          for (const value of row) {
            if (value < ends[2 * a]) ends[2 * a] = value;
            if (value > ends[2 * a + 1]) ends[2 * a + 1] = value;
          }
        }
      }
    });
  }
  const [n0, n1, e0, e1, h0, h1] = ends.map((value) => (Number.isFinite(value) ? value : 0));
  const middle = [(n0 + n1) / 2, (e0 + e1) / 2];
  const box = new THREE.Box3(
    new THREE.Vector3((e0 - middle[1]) / 1000, h0 / 1000, -(n1 - middle[0]) / 1000),
    new THREE.Vector3((e1 - middle[1]) / 1000, h1 / 1000, -(n0 - middle[0]) / 1000)
  );
  return { middle, box, points: pointsOf(runs, middle) };
}

/** About a hundred points of every track, and their projections on the ground. */
function pointsOf(runs, middle) {
  const points = [];
  for (const run of runs) {
    run.aircraft.forEach((_, k) => {
      const track = trackOf(run, "", k, middle).points;
      for (let j = 0; j < track.length; j += 3 * Math.max(1, Math.floor(track.length / 300))) {
        points.push([track[j], track[j + 1], track[j + 2]], [track[j], 0, track[j + 2]]);
      }
    });
  }
  return points;
}

/** Vertical exaggeration that makes heights visible in a wide scene. */
function liftOf(box) {
  const wide = Math.max(box.max.x - box.min.x, box.max.z - box.min.z), tall = Math.max(box.max.y - box.min.y, 0.05);
  return [1, 2, 3, 5].find((lift) => lift * tall >= 0.16 * wide) || 5;
}

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
