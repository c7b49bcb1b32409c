/* Orthographic map, north up: plans, goals, keep-outs, refusals, a flight that is played, and the handles of the scenario. */
"use strict";

const VELOCITY_S = 60, VELOCITY_PX = 20, COURSE_PX = 42;

class LiveMap {
  constructor(place, page) {
    Object.assign(this, { page, view: { north: 0, east: 0, scale: 0.03 }, fitted: false });
    this.svg = place.appendChild(document.createElementNS(SVG, "svg"));
    this.svg.setAttribute("role", "group");
    this.svg.setAttribute("aria-label", "Map, north up");
    this.ground = new Layer(this.svg, "ground");
    this.plan = new Layer(this.svg, "plan");
    this.flown = new Layer(this.svg, "of-flight");
    this.handles = new Handles(this.svg, page);
    this.names = new Layer(this.svg, "names");
    this.legend = place.parentElement.appendChild(Object.assign(element("ul", "legend"), { hidden: true }));
    this.fingers = new Map(); // of a touch screen, by pointer
    this.svg.addEventListener("pointerdown", (event) => this._grab(event));
    this.svg.addEventListener("pointermove", (event) => this._pinch(event));
    for (const type of ["pointerup", "pointercancel"]) this.svg.addEventListener(type, (event) => this.fingers.delete(event.pointerId));
    this.svg.addEventListener("wheel", (event) => {
      event.preventDefault();
      const bounds = this.svg.getBoundingClientRect();
      this.zoom(Math.exp(-0.0015 * event.deltaY), event.clientX - bounds.left, event.clientY - bounds.top);
    }, { passive: false });
    new ResizeObserver(() => {
      Object.assign(this, { width: place.clientWidth, height: place.clientHeight });
      if (!this.fitted) this.fit();
      else this.draw();
    }).observe(place);
    Object.assign(this, { width: place.clientWidth || 600, height: place.clientHeight || 400 });
  }

  x(east) {
    return this.width / 2 + (east - this.view.east) * this.view.scale;
  }

  y(north) {
    return this.height / 2 - (north - this.view.north) * this.view.scale;
  }

  position(x, y) {
    return { north_m: this.view.north - (y - this.height / 2) / this.view.scale, east_m: this.view.east + (x - this.width / 2) / this.view.scale };
  }

  /** Step of positions by zoom, m. */
  get step() {
    return this.view.scale < 0.3 ? 10 : 1;
  }

  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const before = this.position(x, y);
    this.view.scale = Math.min(10, Math.max(1e-4, this.view.scale * factor));
    const after = this.position(x, y);
    this.view.north += before.north_m - after.north_m;
    this.view.east += before.east_m - after.east_m;
    this.fitted = true;
    this.draw();
  }

  /** Two fingers zoom about their middle, and move the map. */
  _pinch(event) {
    const known = this.fingers.get(event.pointerId);
    if (!known) return;
    const bounds = this.svg.getBoundingClientRect(), middle = () => { const [a, b] = [...this.fingers.values()]; return { x: (a.x + b.x) / 2 - bounds.left, y: (a.y + b.y) / 2 - bounds.top, apart: Math.max(20, Math.hypot(a.x - b.x, a.y - b.y)) }; };
    const before = this.fingers.size === 2 && middle();
    Object.assign(known, { x: event.clientX, y: event.clientY });
    if (!before) return;
    const after = middle();
    Object.assign(this.view, { east: this.view.east - (after.x - before.x) / this.view.scale, north: this.view.north + (after.y - before.y) / this.view.scale });
    this.zoom(after.apart / before.apart, after.x, after.y);
  }

  /** Pan by dragging the ground. */
  _grab(event) {
    if (event.button) return;
    if (event.pointerType === "touch") this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.pinched = this.fingers.size > 1; // a finger that stays on the map no longer pans
    const from = [event.clientX, event.clientY], { north, east, scale } = this.view;
    const move = (next) => {
      if (this.pinched || next.pointerId !== event.pointerId) return;
      Object.assign(this.view, { east: east - (next.clientX - from[0]) / scale, north: north + (next.clientY - from[1]) / scale });
      this.fitted = true;
      this.draw();
    };
    const end = (last) => {
      if (last.pointerId !== event.pointerId) return;
      this.svg.removeEventListener("pointermove", move);
      for (const type of ["pointerup", "pointercancel"]) this.svg.removeEventListener(type, end);
      this.svg.classList.remove("panned");
    };
    this.svg.setPointerCapture(event.pointerId);
    this.svg.classList.add("panned");
    this.svg.addEventListener("pointermove", move);
    for (const type of ["pointerup", "pointercancel"]) this.svg.addEventListener(type, end);
  }

  /** Least and greatest north and east of everything, m. */
  _extent() {
    const { scenario, answer } = this.page, north = [], east = [];
    const take = (point) => { if (point && Number.isFinite(point.north_m + point.east_m)) { north.push(point.north_m); east.push(point.east_m); } };
    scenario.list("aircraft").forEach((one) => take(one.start));
    scenario.list("goal").forEach((one) => (one.waypoints || [one]).forEach(take));
    for (const one of scenario.list("keep_out")) for (const sign of [-1, 1]) take({ north_m: one.north_m + sign * one.radius_m, east_m: one.east_m + sign * one.radius_m });
    for (const { track } of answer?.drawn || []) track.north_m.forEach((value, j) => take({ north_m: value, east_m: track.east_m[j] }));
    if (!north.length) take({ north_m: 0, east_m: 0 });
    return [north, east].map((values) => [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))]);
  }

  /** Whether everything lies in the view. */
  showsAll() {
    const [[n0, n1], [e0, e1]] = this._extent();
    return this.x(e0) > 0 && this.x(e1) < this.width && this.y(n1) > 0 && this.y(n0) < this.height;
  }

  /** Show everything. */
  fit() {
    const { answer } = this.page, [[n0, n1], [e0, e1]] = this._extent();
    const scale = Math.min((this.width - 110) / Math.max(e1 - e0, 200), (this.height - 110) / Math.max(n1 - n0, 200));
    Object.assign(this.view, { north: (n0 + n1) / 2, east: (e0 + e1) / 2, scale: Math.max(1e-4, scale) });
    this.fitted = !!answer;
    this.draw();
  }

  _line(layer, key, { north_m, east_m }, attributes) {
    return layer.part(key, "path", { d: linePath(east_m.map((value) => this.x(value)), north_m.map((value) => this.y(value))), ...attributes });
  }

  draw() {
    if (!this.page.scenario.table || !this.width) return;
    this.texts = []; // placed after the names
    this._ground();
    this._plan();
    this._flight();
    this.handles.show(this.page.fixed ? [] : this._handles());
    this._legend();
    this._names();
    for (const layer of [this.ground, this.plan, this.flown, this.names]) layer.end();
  }

  _ground() {
    const { ground, page, width, height, view } = this, step = roundUp(90 / view.scale), low = this.position(0, height), high = this.position(width, 0);
    let lines = "";
    for (let e = Math.ceil(low.east_m / step) * step; e <= high.east_m; e += step) lines += `M${pixel(this.x(e))} 0V${height}`;
    for (let n = Math.ceil(low.north_m / step) * step; n <= high.north_m; n += step) lines += `M0 ${pixel(this.y(n))}H${width}`;
    ground.part("grid", "path", { d: lines, class: "grid" });
    const wind = page.scenario.get("wind") || {}, speed = wind.speed_m_s || 0, long = step * view.scale;
    ground.part("scale", "path", { class: "scale", d: `M${width - 16 - long} ${height - 20}v6h${pixel(long)}v-6` });
    ground.part("scale text", "text", { class: "sign", x: width - 16 - long / 2, y: height - 20, "text-anchor": "middle" }, step >= 1000 ? `${step / 1000} km` : `${step} m`);
    ground.part("north", "path", { class: "sign", d: "M0 -14L5 4L0 0L-5 4Z", transform: `translate(${width - 22} 36)` });
    ground.part("north text", "text", { class: "sign", x: width - 22, y: 17, "text-anchor": "middle" }, "N");
    if (speed > 0) {
      ground.part("wind", "path", { class: "wind", d: "M0 -15V13M0 15L-5 5M0 15L5 5", transform: `translate(${width - 56} 28) rotate(${wind.from_deg || 0})` });
      ground.part("wind text", "text", { class: "sign", x: width - 56, y: 58, "text-anchor": "middle" }, `wind ${printed(speed, speed < 10 ? 1 : 0)} m/s`);
    }
    this._keepOuts();
  }

  _keepOuts() {
    const { page } = this, time = page.playedTime;
    for (const { path, table, from } of page.keepOuts()) {
      const at = motionAt(table, Math.max(0, (time ?? 0) - from)), radius = table.radius_m * this.view.scale, waits = from > (time ?? -1) && from > 0;
      this.ground.part(`keep-out ${path}`, "circle", { class: `keep-out${waits ? " later" : ""}`, cx: pixel(this.x(at.east_m)), cy: pixel(this.y(at.north_m)), r: pixel(Math.max(0, radius)) });
    }
  }

  _plan() {
    const { plan, page } = this, { answer, certified } = page;
    plan.root.classList.toggle("stale", page.isStale);
    plan.root.classList.toggle("behind", page.flight !== null && page.playedTime !== null);
    const refused = answer?.status === "refused", ghost = refused ? certified : null;
    for (const one of ghost?.aircraft || []) this._line(plan, `ghost ${one.name}`, one.track, { class: "ghost", stroke: page.colorOf(one.name) });
    for (const goal of answer?.goals || []) this._line(plan, `goal ${goal.name}`, goal, { class: "goal-track" });
    const bound = new Set(page.problems.flatMap((problem) => problem.aircraft));
    for (const one of answer?.drawn || []) {
      const stroke = page.colorOf(one.name), proven = one.proven ? "" : " unproven";
      if (bound.has(one.name)) this._line(plan, `halo ${one.name}`, one.track, { class: "halo" });
      if (one.hold) this._line(plan, `hold ${one.name}`, one.hold, { class: "hold", stroke });
      this._line(plan, `track ${one.name}`, one.track, { class: `track${proven}`, stroke });
      if (refused && (bound.has(one.name) || !bound.size)) this._attempt(one);
      const { north_m, east_m } = one.rendezvous;
      plan.part(`rendezvous ${one.name}`, "path", { class: "rendezvous", d: SHAPES.diamond, fill: stroke, transform: `translate(${pixel(this.x(east_m))} ${pixel(this.y(north_m))}) scale(0.8)` });
    }
    const pair = answer?.separation;
    if (pair?.positions?.length === 2 && page.playedTime === null) {
      const [a, b] = pair.positions, x = [a, b].map((one) => this.x(one.east_m)), y = [a, b].map((one) => this.y(one.north_m));
      plan.part("pair", "path", { class: "pair", d: linePath(x, y) });
      this.texts.push({ key: "pair text", text: pair.distances_m.map((length) => `${printed(length, 0)} m`).join(" / "), points: [0.5, 0.3, 0.7, 0, 1].map((part) => [x[0] + part * (x[1] - x[0]), y[0] + part * (y[1] - y[0])]), className: "sign" });
    }
    page.problems.flatMap((problem) => problem.positions).forEach(({ north_m, east_m }, k) => {
      plan.part(`ring ${k}`, "circle", { class: "ring", cx: pixel(this.x(east_m)), cy: pixel(this.y(north_m)), r: 17 });
    });
  }

  /** Name of the best attempt of a refused aircraft, beside its track. */
  _attempt({ name, track }) {
    const points = [0.4, 0.25, 0.55, 0.7].map((part) => Math.floor(part * track.north_m.length)).map((j) => [this.x(track.east_m[j]), this.y(track.north_m[j])]);
    this.texts.push({ key: `attempt ${name}`, text: "refused: best attempt", points, className: "attempt", fill: this.page.colorOf(name) });
  }

  /** Signs of the lines on the map, if there are others than certified plans. */
  _legend() {
    const { page, legend } = this, { answer } = page, played = page.flight !== null && page.playedTime !== null, rows = [];
    if (answer?.status === "planned" && played) rows.push(["track", isProven(answer) ? "certified plan" : "plan"]);
    if (answer?.status === "refused" && answer.drawn.length) rows.push(["track unproven", "refused: best attempt"]);
    if (answer?.status === "refused" && page.certified) rows.push(["ghost", isProven(page.certified) ? "last certified plan" : "last plan"]);
    if (played) rows.push([page.flights.outdated ? "flown outdated" : "flown", page.flights.outdated ? "flown: the scenario before the change" : "flown"]);
    const key = JSON.stringify(rows);
    if (key === this.legendKey) return;
    this.legendKey = key;
    legend.hidden = !rows.length;
    legend.replaceChildren(...rows.map(([className, text]) => {
      const row = element("li"), svg = row.appendChild(document.createElementNS(SVG, "svg")), line = svg.appendChild(document.createElementNS(SVG, "path"));
      svg.setAttribute("aria-hidden", "true");
      for (const [name, value] of Object.entries({ d: "M1 6H31", class: className, stroke: "currentColor" })) line.setAttribute(name, value);
      row.append(text);
      return row;
    }));
  }

  _flight() {
    const { flown, page } = this, { flight } = page, time = page.playedTime;
    flown.root.classList.toggle("outdated", page.flights.outdated);
    if (!flight || time === null) return;
    flight.names.forEach((name, k) => {
      const { north_m, east_m, count, here } = flight.until(k, time), stroke = page.colorOf(name);
      this._line(flown, `flown ${name}`, { north_m: north_m.slice(0, count), east_m: east_m.slice(0, count) }, { class: "flown", stroke });
      if (here) flown.part(`symbol ${name}`, "path", { class: "symbol", d: SHAPES.dart, fill: stroke, transform: `translate(${pixel(this.x(here.east_m))} ${pixel(this.y(here.north_m))}) rotate(${pixel(here.course_deg - 90)})` });
    });
    const events = page.scenario.list("event");
    for (const goal of page.scenario.list("goal")) {
      const at = motionAt(goal, time, events);
      flown.part(`goal ${goal.name}`, "path", { class: "played-goal", d: SHAPES.square, transform: `translate(${pixel(this.x(at.east_m))} ${pixel(this.y(at.north_m))})` });
    }
  }

  /** Handle of a horizontal position. */
  _point(key, label, table, path, options, look) {
    const { scenario } = this.page, step = this.step, nudge = roundUp(4 / this.view.scale);
    const put = (north, east, edit) => scenario.edit(() => Object.assign(scenario.get(path), { north_m: roundTo(north, step), east_m: roundTo(east, step) }), edit);
    return {
      key, label: `${label}: ${Math.round(table.north_m)} m north, ${Math.round(table.east_m)} m east`, x: this.x(table.east_m), y: this.y(table.north_m), ...look, ...options,
      drag: (x, y, edit) => { const at = this.position(x, y); put(at.north_m, at.east_m, edit); },
      nudge: (right, up, edit) => { const now = scenario.get(path); put(now.north_m + up * nudge, now.east_m + right * nudge, edit); },
    };
  }

  _handles() {
    const { scenario } = this.page;
    return [
      ...this.page.keepOuts().flatMap(({ path, table, select }) => this._keepOutHandles(path, table, select)),
      ...scenario.list("goal").flatMap((goal, k) => this._goalHandles(goal, k)),
      ...scenario.list("aircraft").flatMap((one, k) => this._aircraftHandles(one, k)),
    ].filter((one) => Number.isFinite(one.x + one.y));
  }

  _aircraftHandles(one, k) {
    const { scenario } = this.page, color = this.page.colorOf(one.name), path = `aircraft[${k}].start`, course = one.start?.course_deg || 0;
    if (!one.start) return [];
    const select = { key: "aircraft", k }, x = this.x(one.start.east_m), y = this.y(one.start.north_m), along = radians(course);
    const put = (value, edit) => scenario.set(`${path}.course_deg`, ((value % 360) + 360) % 360, edit);
    return [
      this._point(`${path}`, `Start of ${one.name}`, one.start, path, { select }, { shape: "dart", color, turn: course - 90 }),
      {
        key: `${path}.course_deg`, label: `Course of ${one.name} at the start`, select, shape: "dot", color, className: "small", x: x + COURSE_PX * Math.sin(along), y: y - COURSE_PX * Math.cos(along),
        stem: [x, y], slider: { min: 0, max: 359, now: (course + 360) % 360, text: `${Math.round((course + 360) % 360)} degrees` },
        drag: (px, py, edit) => put(compassOf(this.y(scenario.get(path).north_m) - py, px - this.x(scenario.get(path).east_m)), edit),
        nudge: (right, up, edit) => put(Math.round(scenario.get(path).course_deg || 0) + right + up, edit),
      },
    ];
  }

  _goalHandles(goal, k) {
    const { scenario } = this.page, path = `goal[${k}]`, select = { key: "goal", k };
    if (goal.waypoints) {
      return goal.waypoints.map((point, j) => this._point(`${path}.waypoints[${j}]`, `Waypoint ${j + 1} of ${goal.name}, at ${point.time_s} s`, point, `${path}.waypoints[${j}]`, { select }, { shape: "square", className: j ? "small" : "" }));
    }
    const speed = goal.speed_m_s || 0, along = radians(goal.course_deg || 0), length = VELOCITY_PX + speed * VELOCITY_S * this.view.scale;
    const put = (value, course, edit) => scenario.edit(() => Object.assign(scenario.get(path), { speed_m_s: Math.max(0, value), ...(course === null ? {} : { course_deg: (course + 360) % 360 }) }), edit);
    const x = this.x(goal.east_m), y = this.y(goal.north_m);
    return [
      this._point(path, `Goal ${goal.name}`, goal, path, { select }, { shape: "square" }),
      {
        key: `${path}.speed_m_s`, label: `Velocity of ${goal.name}: up and down for the speed, left and right for the course`, select, shape: "arrow", className: "small",
        turn: (goal.course_deg || 0) - 90, x: x + length * Math.sin(along), y: y - length * Math.cos(along), stem: [x, y],
        slider: { min: 0, max: 300, now: speed, text: `${printed(speed, 1)} metres per second to ${Math.round(goal.course_deg || 0)} degrees` },
        drag: (px, py, edit) => {
          const now = scenario.get(path), right = px - this.x(now.east_m), up = this.y(now.north_m) - py, value = (Math.hypot(right, up) - VELOCITY_PX) / (VELOCITY_S * this.view.scale);
          put(roundTo(value, 0.5), compassOf(up, right), edit);
        },
        nudge: (right, up, edit) => { const now = scenario.get(path); put(roundTo((now.speed_m_s || 0) + 0.5 * up, 0.5), right ? Math.round((now.course_deg || 0) + right) % 360 : null, edit); },
      },
    ];
  }

  _keepOutHandles(path, table, select) {
    const { scenario } = this.page, put = (value, edit) => scenario.set(`${path}.radius_m`, Math.max(10, roundTo(value, this.step)), edit);
    const area = table.radius_m * this.view.scale, wide = area > 0.4 * Math.min(this.width, this.height); // then by its rim: the map can still be moved
    return [
      this._point(path, `Keep-out ${table.name}`, table, path, { select, area }, { shape: "cross", color: "var(--limit)", className: wide ? "rim" : "" }),
      {
        key: `${path}.radius_m`, label: `Radius of the keep-out ${table.name}`, select, shape: "dot", color: "var(--limit)", className: "small", x: this.x(table.east_m + table.radius_m), y: this.y(table.north_m),
        slider: { min: 10, max: 50000, now: table.radius_m, text: `${Math.round(table.radius_m)} metres` },
        drag: (px, py, edit) => { const now = scenario.get(path); put(Math.hypot(px - this.x(now.east_m), py - this.y(now.north_m)) / this.view.scale, edit); },
        nudge: (right, up, edit) => put(scenario.get(path).radius_m + (right + up) * roundUp(4 / this.view.scale), edit),
      },
    ];
  }

  /** Boxes that names keep clear of: the buttons, the signs in the corners, the handles. */
  _obstacles() {
    const { width, height, legend } = this, box = (x0, y0, x1, y1) => ({ x0, y0, x1, y1 }), handles = [];
    for (const { x, y } of this.handles.definitions.values()) handles.push(box(x - 7, y - 7, x + 7, y + 7));
    const key = legend.hidden ? [] : [box(0, height - 20 - 20 * legend.childElementCount, 240, height)];
    return [box(0, 0, 130, 44), box(width - 100, 0, width, 64), box(width - 190, height - 40, width, height), ...key, ...handles];
  }

  /** Names and stems; a text takes the first place beside its point that is free. */
  _names() {
    const { page, names } = this, taken = this._obstacles();
    for (const { key, stem, x, y, color = "var(--goal)" } of this.handles.definitions.values()) if (stem) names.part(`stem ${key}`, "path", { class: "stem", stroke: color, d: `M${pixel(stem[0])} ${pixel(stem[1])}L${pixel(x)} ${pixel(y)}` });
    const place = ({ key, text, points, className, fill = "" }) => {
      const long = 7.2 * text.length, boxes = points.filter(([x, y]) => Number.isFinite(x + y)).flatMap(([x, y]) =>
        [[12, 17], [12, -8], [-12 - long, 17], [-12 - long, -8], [-long / 2, 27], [-long / 2, -17], [12, 30], [12, -21], [12, 43], [12, 56]].map(([dx, dy]) => ({ x0: x + dx, x1: x + dx + long, y0: y + dy - 11, y1: y + dy + 3 })));
      if (!boxes.length) return;
      const inside = boxes.filter((one) => one.x0 > 0 && one.x1 < this.width && one.y0 > 0 && one.y1 < this.height);
      const free = inside.find((one) => taken.every((other) => one.x1 < other.x0 || one.x0 > other.x1 || one.y1 < other.y0 || one.y0 > other.y1)) ?? inside[0] ?? boxes[0];
      taken.push(free);
      names.part(key, "text", { class: className, x: pixel(free.x0), y: pixel(free.y0 + 11), ...(fill ? { fill } : {}) }, text);
    };
    const write = (key, text, east, north, className, fill) => place({ key, text, points: [[this.x(east), this.y(north)]], className, fill });
    const time = page.playedTime ?? 0;
    page.scenario.list("aircraft").forEach((one, k) => {
      const index = page.flight && page.playedTime !== null ? page.flight.names.indexOf(one.name) : -1, at = index >= 0 ? page.flight.until(index, time).here : one.start;
      if (at) write(`aircraft ${k}`, one.name, at.east_m, at.north_m, "of-aircraft", page.colorOf(one.name));
    });
    page.scenario.list("goal").forEach((goal, k) => { const at = motionAt(goal, time, page.scenario.list("event")); write(`goal ${k}`, goal.name, at.east_m, at.north_m, "of-goal", "var(--goal)"); });
    for (const { path, table } of page.keepOuts()) write(path, table.name, table.east_m, table.north_m, "of-goal", "var(--limit)");
    for (const one of this.texts) place({ ...one, className: `${one.className}${page.isStale ? " stale" : ""}` });
  }
}
