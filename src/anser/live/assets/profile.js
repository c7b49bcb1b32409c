/* Altitude profile: altitude over time, with handles for the start and the rendezvous. */
"use strict";

const PROFILE_LEFT = 46, PROFILE_TOP = 10, PROFILE_RIGHT = 22, PROFILE_BOTTOM = 26, ALTITUDE_STEP_M = 10;

class Profile {
  constructor(place, page) {
    Object.assign(this, { page, width: 400, height: 160 });
    this.svg = place.appendChild(document.createElementNS(SVG, "svg"));
    this.svg.setAttribute("role", "group");
    this.svg.setAttribute("aria-label", "Altitude over time");
    this.ground = new Layer(this.svg, "ground");
    this.plan = new Layer(this.svg, "plan");
    this.flown = new Layer(this.svg, "of-flight");
    this.handles = new Handles(this.svg, page);
    new ResizeObserver(() => {
      Object.assign(this, { width: place.clientWidth, height: place.clientHeight });
      this.draw();
    }).observe(place);
  }

  x(time) {
    return PROFILE_LEFT + (time / this.last) * (this.width - PROFILE_LEFT - PROFILE_RIGHT);
  }

  y(altitude) {
    const [low, high] = this.range;
    return PROFILE_TOP + ((high - altitude) / (high - low)) * (this.height - PROFILE_TOP - PROFILE_BOTTOM);
  }

  altitude(y) {
    const [low, high] = this.range;
    return high - ((y - PROFILE_TOP) / (this.height - PROFILE_TOP - PROFILE_BOTTOM)) * (high - low);
  }

  /** The last certified plan beside a refusal. */
  get _ghost() {
    return this.page.answer?.status === "refused" ? this.page.certified : null;
  }

  /** Ranges of time and altitude; they stay during a drag. */
  _scale() {
    if (this.handles.held && this.range) return;
    const { answer, flight, scenario, playedTime } = this.page, altitudes = [0], times = [60];
    for (const one of [...(answer?.drawn || []), ...(this._ghost?.aircraft || [])]) {
      altitudes.push(...one.track.altitude_m, one.rendezvous.altitude_m);
      times.push(one.track.time_s.at(-1) ?? 0);
    }
    scenario.list("aircraft").forEach((one) => altitudes.push(one.start?.altitude_m || 0));
    if (flight && playedTime !== null) {
      times.push(flight.end);
      flight.altitude_m.forEach((row) => { for (const value of row) altitudes.push(value); });
    }
    const finite = altitudes.filter(Number.isFinite), low = Math.min(...finite), high = Math.max(...finite, low + 100);
    this.range = [low, high + 0.12 * (high - low)];
    this.last = Math.max(...times);
  }

  draw() {
    const { page, plan, flown } = this;
    if (!page.scenario.table || !this.width) return;
    this._scale();
    this._axes();
    plan.root.classList.toggle("stale", page.isStale);
    flown.root.classList.toggle("outdated", page.flights.outdated);
    plan.root.classList.toggle("behind", page.flight !== null && page.playedTime !== null);
    const line = (times, altitudes) => linePath(times.map((time) => this.x(time)), altitudes.map((altitude) => this.y(altitude)));
    for (const one of this._ghost?.aircraft || []) plan.part(`ghost ${one.name}`, "path", { class: "ghost", stroke: page.colorOf(one.name), d: line(one.track.time_s, one.track.altitude_m) });
    for (const one of page.answer?.drawn || []) {
      plan.part(`track ${one.name}`, "path", { class: `track${one.proven ? "" : " unproven"}`, stroke: page.colorOf(one.name), d: line(one.track.time_s, one.track.altitude_m) });
    }
    const { flight, playedTime } = page;
    if (flight && playedTime !== null) {
      flight.names.forEach((name, k) => {
        const { count } = flight.until(k, playedTime);
        flown.part(name, "path", { class: "flown", stroke: page.colorOf(name), d: line(flight.time_s.slice(0, count), flight.altitude_m[k].slice(0, count)) });
      });
      flown.part("time", "path", { class: "cursor", d: `M${pixel(this.x(playedTime))} ${PROFILE_TOP}V${this.height - PROFILE_BOTTOM}` });
    }
    this.handles.show(page.fixed ? [] : this._handles());
    for (const layer of [this.ground, plan, flown]) layer.end();
  }

  _axes() {
    const { ground, width, height } = this, [low, high] = this.range, bottom = height - PROFILE_BOTTOM;
    const rise = roundUp((high - low) / Math.max(2, (bottom - PROFILE_TOP) / 34)), step = roundUp(this.last / Math.max(2, (width - PROFILE_LEFT) / 80));
    let lines = "";
    for (let h = Math.ceil(low / rise) * rise; h <= high; h += rise) {
      lines += `M${PROFILE_LEFT} ${pixel(this.y(h))}H${width - PROFILE_RIGHT}`;
      ground.part(`h ${h}`, "text", { class: "sign", x: PROFILE_LEFT - 6, y: pixel(this.y(h) + 4), "text-anchor": "end" }, printed(h, 0));
    }
    for (let t = 0; t <= this.last; t += step) {
      lines += `M${pixel(this.x(t))} ${PROFILE_TOP}V${bottom}`;
      ground.part(`t ${t}`, "text", { class: "sign", x: pixel(this.x(t)), y: bottom + 14, "text-anchor": "middle" }, printed(t, 0));
    }
    ground.part("grid", "path", { class: "grid", d: lines });
    ground.part("names", "text", { class: "sign", x: width - PROFILE_RIGHT, y: height - 2, "text-anchor": "end" }, "altitude (m) over time (s)");
    const floor = this.page.scenario.number("limits.altitude_min_m", 100);
    if (floor > low) ground.part("floor", "path", { class: "limit", d: `M${PROFILE_LEFT} ${pixel(this.y(floor))}H${width - PROFILE_RIGHT}` });
  }

  _handles() {
    const { scenario, answer } = this.page;
    return scenario.list("aircraft").flatMap((one, k) => {
      const color = this.page.colorOf(one.name), select = { key: "aircraft", k }, goal = scenario.list("goal").find((table) => table.name === one.goal);
      const planned = answer?.aircraft.find((row) => row.name === one.name), arrival = planned?.arrival_s ?? planned?.track.time_s.at(-1) ?? this.last;
      const found = [this._handle(`aircraft[${k}].start.altitude_m`, `Altitude of ${one.name} at the start`, 0, one.start?.altitude_m ?? 0, 0, { select, color, shape: "dot" })];
      if (!goal) return found;
      const ground = motionAt(goal, arrival).altitude_m, up = one.rendezvous?.stand_off_up_m ?? 300;
      found.push(this._handle(`aircraft[${k}].rendezvous.stand_off_up_m`, `Rendezvous altitude of ${one.name}`, arrival, ground + up, ground, { select, color, shape: "diamond" }));
      return found;
    });
  }

  /** Handle of the altitude `base` plus the value at a key path. */
  _handle(path, label, time, altitude, base, look) {
    const { scenario } = this.page, put = (value, edit) => scenario.set(path, roundTo(value - base, ALTITUDE_STEP_M), edit);
    return {
      key: path, label, x: this.x(Math.min(time, this.last)), y: this.y(altitude), ...look, className: "upright",
      slider: { min: -500, max: 15240, now: Math.round(altitude), text: `${Math.round(altitude)} metres` },
      drag: (x, y, edit) => put(this.altitude(y), edit),
      nudge: (right, up, edit) => put(altitude + ALTITUDE_STEP_M * (right + up), edit),
    };
  }
}
