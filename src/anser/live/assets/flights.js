/* Flights: rows as they are computed, the player over the map, events, and the reports. */
"use strict";

const ROWS_MAX = 20000, FLIGHTS_MAX = 30, EVENT_NAMES = {
  "aircraft-leaves": (event) => `${event.aircraft} leaves`, "goal-turns": (event) => `${event.goal} turns to ${event.course_deg}°`, "goal-stops": (event) => `${event.goal} stops`,
  "keep-out-appears": (event) => `keep-out ${event.keep_out?.name} appears`, "thrust-lost": (event) => `${event.aircraft} has ${Math.round(100 * (event.thrust_left ?? 1))} % of the thrust`,
};

/** Rows of a flight: time, and north, east, altitude of each aircraft; `text` is the scenario that is flown. */
class FlightRows {
  constructor(text) {
    Object.assign(this, { text, names: [], time_s: [], north_m: [], east_m: [], altitude_m: [] });
  }

  get end() {
    return this.time_s.at(-1) ?? 0;
  }

  append({ time_s, aircraft }) {
    if (!this.names.length) {
      this.names = aircraft.map((one) => one.name);
      for (const axis of ["north_m", "east_m", "altitude_m"]) this[axis] = aircraft.map(() => []);
    }
    if (this.time_s.length + time_s.length > ROWS_MAX) return;
    const first = time_s.findIndex((time) => time > (this.time_s.at(-1) ?? -1));
    if (first < 0) return;
    this.time_s.push(...time_s.slice(first));
    for (const axis of ["north_m", "east_m", "altitude_m"]) aircraft.forEach((one, k) => this[axis][k].push(...one[axis].slice(first).map((value) => value ?? NaN)));
  }

  /** Rows of an aircraft up to a time: its coordinates, their number, and the position and course at that time. */
  until(k, time) {
    let low = 0, high = this.time_s.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time_s[middle] <= time) low = middle + 1;
      else high = middle;
    }
    const j = low - 1, [north_m, east_m, altitude_m] = [this.north_m[k], this.east_m[k], this.altitude_m[k]];
    if (j < 0 || !Number.isFinite(north_m[j])) return { north_m, east_m, count: low, here: null };
    const next = Math.min(j + 1, this.time_s.length - 1), before = next > j ? j : Math.max(0, j - 1), part = next > j ? (time - this.time_s[j]) / (this.time_s[next] - this.time_s[j]) : 0;
    const at = (row) => row[j] + Math.min(1, Math.max(0, part)) * (row[next] - row[j] || 0);
    const course_deg = (Math.atan2(east_m[next] - east_m[before], north_m[next] - north_m[before]) * 180) / Math.PI;
    return { north_m, east_m, count: low, here: { north_m: at(north_m), east_m: at(east_m), altitude_m: at(altitude_m), course_deg: Number.isFinite(course_deg) ? course_deg : 0 } };
  }
}

class Flights {
  constructor(page) {
    Object.assign(this, { page, rows: null, time: null, number: 0, playing: false, known: [], chosen: null, outdated: false });
    const at = (id) => document.getElementById(id);
    Object.assign(this, { bar: at("player"), play: at("play"), slider: at("time"), told: at("told"), events: at("events"), list: at("flights"), fly: at("fly"), eventAdd: at("event-add") });
    this.fly.addEventListener("click", () => (this.number ? this.stop() : this.start()));
    this.play.addEventListener("click", () => this.setPlaying(!this.playing));
    this.slider.addEventListener("input", () => { this.setPlaying(false); this.setTime(Number(this.slider.value)); });
    at("back-to-plan").addEventListener("click", () => this.leave());
    this.list.addEventListener("change", () => this._choose(this.known.find((one) => one.id === this.list.value)));
    this.eventAdd.addEventListener("change", () => {
      const { value } = this.eventAdd;
      this.eventAdd.value = "";
      if (value) this._add(JSON.parse(value));
    });
    document.querySelectorAll("[role=tab]").forEach((tab) => {
      tab.addEventListener("click", () => this.show(tab.dataset.tab));
      tab.addEventListener("keydown", (event) => {
        const tabs = [...document.querySelectorAll("[role=tab]:not([disabled])")], step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (step) tabs[(tabs.indexOf(tab) + step + tabs.length) % tabs.length].focus();
      });
    });
  }

  /** Fly the present scenario; `from` is the time at which the player goes on once the rows reach it. */
  start(from = 0) {
    const { scenario, connection } = this.page;
    const number = connection.send("fly", { scenario: scenario.table, compare: this.known.at(-1)?.id ?? null }, (message) => this._ended(message, number));
    this.number = number;
    if (!number) return;
    Object.assign(this, { incoming: new FlightRows(JSON.stringify(scenario.table)), from, waits: true, outdated: false });
    if (!this.rows) this.rows = this.incoming;
    this.time ??= 0;
    this.show("plan");
    this.draw();
    this.page.report();
  }

  /** The scenario has changed: tracks of the former one vanish, or fade as long as it is being flown. */
  changed() {
    if (!this.rows || this.adding) return;
    const flown = this.number ? this.incoming : this.rows, other = flown.text !== JSON.stringify(this.page.scenario.table);
    if (other && !this.number) this.leave();
    else this.outdated = other;
  }

  stop() {
    this.page.connection.send("stop");
  }

  /** Rows of the flight in progress; a repeated flight takes the place of the former when it has reached the played time. */
  append(message) {
    if (message.number !== this.number) return;
    this.incoming.append(message);
    if (this.waits && this.incoming.end >= this.from) {
      this.waits = false;
      this.rows = this.incoming;
      this.time = this.from;
      this.setPlaying(true);
    }
    this.page.draw();
    this.draw();
  }

  _ended(message, number) {
    if (number !== this.number) return; // the answer to a flight that was stopped for the present one
    this.number = 0;
    if (message.type === "flight") {
      if (this.incoming?.time_s.length) Object.assign(this, { rows: this.incoming, waits: false });
      const entry = { id: message.id, report: message.report, compare: message.compare, name: `${message.success ? "✓" : "✗"} ${message.verdict}` };
      this.known = [...this.known.filter((one) => one.id !== entry.id), entry].slice(-FLIGHTS_MAX);
      this._choose(entry);
      this.page.say(message.verdict);
    } else if (message.type === "failed") this.page.fail(message.problems);
    this.changed();
    if (!this.rows?.time_s.length) Object.assign(this, { rows: null, time: null });
    this.page.draw();
    this.draw();
    this.page.report();
  }

  /** The connection is cut: the flight in progress may be lost. */
  cut() {
    this.number = 0;
    this.changed();
    this.draw();
  }

  welcome(entries) {
    for (const entry of entries) if (!this.known.some((one) => one.id === entry.id)) this.known.push(entry);
    this.chosen ??= this.known.at(-1) ?? null;
    this._choose(this.chosen);
  }

  _choose(entry) {
    this.chosen = entry ?? null;
    this.list.replaceChildren(...this.known.map((one, k) => Object.assign(element("option", "", `${k + 1} ${one.name ?? one.id}`.replace(/ [^:]*: /, " ")), { value: one.id })));
    this.list.title = entry?.name ?? "";
    if (entry) this.list.value = entry.id;
    this.list.hidden = !this.known.length;
    document.getElementById("tab-flight").disabled = !entry;
    document.getElementById("tab-compare").disabled = !entry?.compare;
    if (this.tab && this.tab !== "plan") this.show(this.tab === "compare" && !entry?.compare ? "flight" : this.tab);
  }

  /** Show a tab: plan, flight or compare. The reports are loaded when they are shown. */
  show(tab) {
    this.tab = tab;
    document.querySelectorAll("[role=tab]").forEach((one) => {
      one.setAttribute("aria-selected", String(one.dataset.tab === tab));
      one.tabIndex = one.dataset.tab === tab ? 0 : -1;
    });
    document.getElementById("panel-plan").hidden = tab !== "plan";
    const panel = document.getElementById("panel-report"), frame = panel.querySelector("iframe");
    panel.hidden = tab === "plan";
    panel.setAttribute("aria-labelledby", `tab-${tab}`);
    const address = tab === "plan" ? "" : tab === "compare" ? this.chosen.compare : this.chosen.report;
    if (!address) frame.removeAttribute("src"); // the report's memory is free while the plan is edited
    else if (frame.getAttribute("src") !== address) frame.setAttribute("src", address);
  }

  setTime(time) {
    this.time = Math.min(this.rows.end, Math.max(0, time));
    this.page.draw();
    this.draw();
  }

  setPlaying(playing) {
    if (playing === this.playing) return;
    this.playing = playing;
    if (playing && this.time >= this.rows.end && !this.number) this.time = 0;
    let last = performance.now();
    const step = (now) => {
      if (!this.playing || !this.rows) return;
      const rate = Number(document.getElementById("rate").value);
      this.setTime(this.time + (rate * Math.min(200, now - last)) / 1000);
      last = now;
      if (this.time >= this.rows.end && !this.number) this.setPlaying(false);
      else requestAnimationFrame(step);
    };
    if (playing) requestAnimationFrame(step);
    this.draw();
  }

  /** Leave the player: the map shows the plan again. */
  leave() {
    this.setPlaying(false);
    Object.assign(this, { rows: null, time: null, waits: false, outdated: false });
    this.draw();
    this.page.draw();
  }

  /** Add an event at the played time to the scenario, and fly again. */
  _add(event) {
    const { scenario } = this.page, time_s = roundTo(this.time, 0.1);
    if (event.keep_out) event.keep_out = this._keepOut(event.keep_out, time_s);
    this.adding = true; // the former flight stays until the new one has reached this time
    scenario.edit((table) => { (table.event ??= []).push({ time_s, ...event }); });
    this.adding = false;
    if (this.number) this.stop();
    this.setPlaying(false);
    this.start(time_s);
  }

  /** A keep-out on the way of an aircraft, between its position and its rendezvous. */
  _keepOut({ before }, time) {
    const k = this.rows.names.indexOf(before), here = this.rows.until(k, time).here, goal = this.page.answer?.aircraft.find((one) => one.name === before)?.rendezvous ?? here;
    const middle = (axis) => roundTo((here[axis] + goal[axis]) / 2, 10), away = Math.hypot(goal.north_m - here.north_m, goal.east_m - here.east_m);
    const taken = new Set(this.page.keepOuts().map(({ table }) => table.name));
    let n = 1;
    while (taken.has(`cell-${n}`)) n++;
    return { name: `cell-${n}`, north_m: middle("north_m"), east_m: middle("east_m"), radius_m: Math.max(100, roundTo(0.12 * away, 10)) };
  }

  _offers() {
    const { scenario } = this.page, offers = [];
    for (const { name } of scenario.list("aircraft")) {
      offers.push([`${name} leaves`, { kind: "aircraft-leaves", aircraft: name }], [`${name} loses 40 % of its thrust`, { kind: "thrust-lost", aircraft: name, thrust_left: 0.6 }]);
      offers.push([`keep-out appears before ${name}`, { kind: "keep-out-appears", keep_out: { before: name } }]);
    }
    for (const goal of scenario.list("goal")) {
      const turned = (Math.round(motionAt(goal, this.time, scenario.list("event")).course_deg + 90) + 360) % 360;
      offers.push([`${goal.name} turns right by 90°`, { kind: "goal-turns", goal: goal.name, course_deg: turned }], [`${goal.name} stops`, { kind: "goal-stops", goal: goal.name }]);
    }
    return offers;
  }

  draw() {
    const { rows, page } = this, shown = rows !== null && this.time !== null;
    this.fly.textContent = this.number ? "Stop" : "Fly";
    this.bar.hidden = !shown;
    if (shown) {
      this.slider.max = String(rows.end || 1);
      this.slider.value = String(this.time);
      this.told.textContent = `${this.time.toFixed(1)} of ${rows.end.toFixed(0)} s${this.number ? ", being flown" : ""}`;
      this.play.textContent = this.playing ? "❚❚" : "▶";
      this.play.setAttribute("aria-label", this.playing ? "Pause" : "Play");
      const offers = this._offers(), key = JSON.stringify(offers);
      if (key !== this.offered) {
        this.offered = key;
        this.eventAdd.replaceChildren(Object.assign(element("option", "", "Let something happen now …"), { value: "" }), ...offers.map(([text, event]) => Object.assign(element("option", "", text), { value: JSON.stringify(event) })));
      }
    }
    const events = page.scenario.list("event"), key = JSON.stringify(events);
    if (key === this.listed) return;
    this.listed = key;
    this.events.hidden = !events.length;
    this.events.replaceChildren(...events.map((event, k) => {
      const item = element("li", "", `${event.time_s} s: ${EVENT_NAMES[event.kind]?.(event) ?? event.kind} `), remove = element("button", "plain", "remove");
      remove.type = "button";
      remove.setAttribute("aria-label", `Remove the event: ${item.textContent}`);
      remove.disabled = page.fixed;
      remove.addEventListener("click", () => page.remove({ key: "event", k }));
      item.append(remove);
      return item;
    }));
  }
}
