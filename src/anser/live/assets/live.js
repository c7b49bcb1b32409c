/* The live page: the parts share the scenario, the answer to it, and the flight that is played. */
"use strict";

const STATUS_MS = 500, SESSION = "anser live session";

class LivePage {
  constructor({ colors, recording }) {
    const at = (id) => document.getElementById(id);
    Object.assign(this, { colors, recording, answer: null, certified: null, problems: [], invalid: false, searching: false, told: false, refit: false, welcome: null, progress: null, message: "", frame: 0 });
    this.scenario = new Scenario();
    this.session = recording ? null : TabStorage.get(SESSION); // known to the server after a reload or a cut
    this.latencies = new Latencies();
    this.connection = new Connection();
    this.requests = new PlanRequests(this.connection, this.scenario);
    this.status = at("status");
    this.waited = at("waited");
    this.flights = new Flights(this);
    this.map = new LiveMap(at("map"), this);
    this.profile = new Profile(at("profile"), this);
    this.scene = new SceneView(at("scene"), this);
    this.panel = new AnswerPanel(at("answer"), this);
    this.inputs = new Inputs(at("inputs"), this);
    this.files = new FileDialogs(this);
    this._buttons(at);
    if (recording) this._startRecording(at);
    else this._connect();
  }

  /** Whether nothing may be edited: a recorded page. */
  get fixed() {
    return this.recording !== null;
  }

  get flight() {
    return this.flights.rows;
  }

  /** Time of the flight that is played, s, or null. */
  get playedTime() {
    return this.flights.rows ? this.flights.time : null;
  }

  /** Whether the answer belongs to an earlier scenario. */
  get isStale() {
    return this.invalid || this.searching;
  }

  hueOf(name) {
    const k = this.scenario.list("aircraft").findIndex((one) => one.name === name);
    return k < 0 ? "others" : `c${k % this.colors}`;
  }

  colorOf(name) {
    return `var(--${this.hueOf(name)})`;
  }

  /** Keep-outs from the beginning and from events, each with its key path and the time from which it is there. */
  keepOuts() {
    const from = this.scenario.list("keep_out").map((table, k) => ({ path: `keep_out[${k}]`, table, from: 0, select: { key: "keep_out", k } }));
    const later = this.scenario.list("event").map((event, k) => ({ path: `event[${k}].keep_out`, table: event.keep_out, from: event.time_s, select: { key: "event", k } }));
    return [...from, ...later.filter(({ table }) => table)];
  }

  _buttons(at) {
    const { scenario } = this;
    at("undo").addEventListener("click", () => scenario.undo());
    at("redo").addEventListener("click", () => scenario.redo());
    at("fit").addEventListener("click", () => this.map.fit());
    at("zoom-in").addEventListener("click", () => this.map.zoom(1.4));
    at("zoom-out").addEventListener("click", () => this.map.zoom(1 / 1.4));
    document.addEventListener("keydown", (event) => this._key(event));
    scenario.on((stamp) => {
      if (!this.fixed) this.requests.ask(stamp);
      if (this.told) Object.assign(this, { searching: false, invalid: false, told: false, problems: [] });
      this.flights.changed();
      this.draw();
      this.report();
    });
    Theme.on(() => this.draw());
  }

  _key(event) {
    const typed = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "range";
    if (this.fixed || document.querySelector("dialog[open]")) return;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z" && !typed) {
      event.preventDefault();
      if (event.shiftKey) this.scenario.redo();
      else this.scenario.undo();
    } else if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "s") {
      event.preventDefault();
      this.files.save();
    }
  }

  _connect() {
    const { connection, flights } = this;
    connection.on("open", (again) => {
      this.message = "";
      if (this.session) connection.send("resume", { session: this.session, flight_ids: flights.known.map((one) => one.id) });
      if (this.scenario.table) this.requests.ask(performance.now());
      this.report();
    });
    connection.on("closed", () => {
      this.requests.reset();
      flights.cut();
      this.progress = null;
      this.report();
    });
    connection.on("welcome", (message) => this._welcome(message));
    connection.on("plan", (message) => this._planned(message));
    connection.on("preliminary", (message) => this._preliminary(message));
    connection.on("rows", (message) => flights.append(message));
    connection.on("flight", (message) => flights.welcome([{ ...message, name: message.name ?? message.verdict }]));
    connection.on("progress", (message) => {
      this.progress = message;
      this.report();
    });
    connection.on("failed", (message) => this._failed(message));
    connection.start();
    setInterval(() => this._wait(), STATUS_MS);
    this.report();
  }

  _welcome(message) {
    const before = this.scenario.table !== null;
    this.welcome = message;
    if (!this.session) TabStorage.set(SESSION, (this.session = message.session));
    if (before || this.scenario.restore()) this.scenario._tell(performance.now());
    else this.scenario.open(message.scenario, message.name);
    if (!this.map.fitted) this.map.fit();
    this.flights.welcome(message.flights);
    document.documentElement.dataset.ready ||= "1";
    this.report();
  }

  /** An answer to a plan request: it is drawn at once, unless a newer one is shown. */
  _planned({ number, answer }) {
    if (!this.requests.answer(number)) return;
    if (answer.status !== "invalid") this.message = "";
    this._take(answer);
    const stamp = this.requests.stamps.get(number);
    this.drawNow();
    if (stamp !== undefined) this.latencies.measure(number, stamp, answer.elapsed_ms);
    this.requests.stamps.delete(number);
    this.progress = null;
    this.report();
  }

  /** What is known while the search for the answer goes on. */
  _preliminary({ number, answer }) {
    if (number !== this.requests.flying) return;
    Object.assign(this, { problems: answer.problems, invalid: answer.status === "invalid", searching: answer.status === "searching", told: true });
    this.draw();
    this.report();
  }

  _take(answer) {
    Object.assign(this, { problems: answer.problems || [], searching: false, told: false });
    answer.drawn = (answer.aircraft || []).filter((one) => one.drawn !== false);
    this.invalid = answer.status === "invalid";
    if (this.invalid) return; // the last answer stays, in grey
    this.answer = answer;
    if (this.welcome && answer.sliders) Object.assign(this.welcome, { sliders: answer.sliders, templates: answer.templates });
    if (answer.status === "planned") this.certified = answer;
    if (!this.map.fitted || (this.refit && !this.map.showsAll())) this.map.fit();
    this.refit = false;
  }

  _failed({ number, problems }) {
    if (this.requests.stamps.has(number)) {
      this.requests.answer(number);
      Object.assign(this, { problems, invalid: true, searching: false });
      this.draw();
    }
    this.fail(problems);
  }

  /** Draw everything in the next frame. */
  draw() {
    this.frame ||= requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    if (!this.scenario.table) return;
    this.map.draw();
    this.profile.draw();
    this.inputs.draw(); // first, for the answer names empty fields
    const shown = [this.answer, this.problems, this.invalid, this.searching];
    if (shown.some((part, k) => part !== this.shown?.[k])) this.panel.draw();
    this.shown = shown;
    this.flights.draw();
    this.scene.draw();
    document.getElementById("undo").disabled = this.fixed || !this.scenario.done.length;
    document.getElementById("redo").disabled = this.fixed || !this.scenario.undone.length;
  }

  /** A drag has ended: the final scenario is planned. */
  released() {
    this.scenario.release();
    this.requests.finish();
    this.draw();
  }

  /** Add an aircraft, a goal or a keep-out, or an aircraft together with a goal of its own ("pair"). */
  add(key) {
    const { scenario } = this, list = key === "pair" ? "aircraft" : key;
    let k = 0, told = "";
    scenario.together(() => {
      if (key === "pair") scenario.add("goal", this._newGoal());
      k = scenario.add(list, list === "aircraft" ? this._newAircraft(key === "pair") : list === "goal" ? this._newGoal() : this._newKeepOut());
      if (key === "goal") told = this._redirect(k);
    });
    const path = `${list}[${k}]`;
    this.inputs.opened.add(path);
    this.refit = true;
    if (!this.map.showsAll()) this.map.fit();
    this.drawNow();
    this.inputs.jump(path);
    if (told) this.say(told);
  }

  /** A free place beside the last of the tables, or in the middle of the map; north and east, m. */
  _place(tables) {
    const { map } = this, last = tables.at(-1), apart = 60 / map.view.scale, at = last && { north_m: last.north_m, east_m: last.east_m };
    const place = at ?? { north_m: map.view.north, east_m: map.view.east }, taken = (one) => tables.some((table) => Math.hypot(table.north_m - one.north_m, table.east_m - one.east_m) < 0.7 * apart);
    for (let n = 0; n < 40 && taken(place); n++) place.east_m += apart;
    return { north_m: roundTo(place.north_m, 10), east_m: roundTo(place.east_m, 10) };
  }

  /** An aircraft like the last one, beside it; its goal is the last one, or the first that no aircraft flies to. */
  _newAircraft(last) {
    const { scenario, welcome } = this, fleet = scenario.list("aircraft"), goals = scenario.list("goal"), template = structuredClone(fleet.at(-1) ?? welcome.templates.aircraft);
    const free = last ? goals.at(-1) : goals.find(({ name }) => !fleet.some((one) => one.goal === name)) ?? goals[fleet.length % Math.max(1, goals.length)];
    return { ...template, goal: free?.name ?? template.goal, start: { ...template.start, ...this._place(fleet.map((one) => one.start ?? {})) } };
  }

  /** A goal of the kind and the velocity of the last one, beside it. */
  _newGoal() {
    const goals = this.scenario.list("goal"), { waypoints, ...last } = structuredClone(goals.at(-1) ?? this.welcome.templates.goal), at = waypoints?.[0] ?? {};
    const places = goals.map((goal) => goal.waypoints?.[0] ?? goal);
    return { ...last, ...(waypoints ? { altitude_m: at.altitude_m ?? 0 } : {}), ...this._place(places) };
  }

  _newKeepOut() {
    const { north, east } = this.map.view;
    return { ...structuredClone(this.welcome.templates.keep_out), north_m: roundTo(north, 10), east_m: roundTo(east, 10) };
  }

  /** Send an aircraft that shares its goal to the new goal. Returns a sentence about it, or nothing. */
  _redirect(k) {
    const { scenario } = this, fleet = scenario.list("aircraft"), { name } = scenario.list("goal")[k];
    const shared = fleet.findLast((one) => fleet.filter((other) => other.goal === one.goal).length > 1);
    if (!shared) return "";
    scenario.edit(() => { shared.goal = name; });
    return `${shared.name} flies to ${name} now.`;
  }

  remove({ key, k }) {
    if (!this.fixed && this.scenario.list(key)[k]) this.scenario.remove(key, k);
  }

  nameOfKey(key) {
    return this.inputs.nameOfKey(key);
  }

  jump(key) {
    this.flights.show("plan");
    this.inputs.jump(key);
  }

  opened(table, name) {
    this.flights.leave();
    Object.assign(this, { answer: null, certified: null, problems: [], invalid: false, searching: false, shown: null });
    this.map.fitted = false;
    this.scenario.open(table, name);
    this.map.fit();
  }

  /** Send a request; a failure is told in the status line. */
  request(type, content, reply) {
    const number = this.connection.send(type, content, (message) => (message.type === "failed" ? this.fail(message.problems) : reply(message)));
    if (!number) this.say("No connection to the server: try again when it is back.");
  }

  fail(problems) {
    this.say(problems.map((problem) => problem.text).join(" "));
  }

  say(text) {
    this.message = text;
    this.report();
  }

  /** State of the page in words; the seconds that pass are not announced. */
  report() {
    if (this.recording) return;
    const { connection, progress, scenario } = this, planning = this.requests.flying && performance.now() - this.requests.since > 300;
    const compiling = progress && (this.requests.flying || this.flights.number);
    const state = !connection.open ? (connection.opened ? "Connection lost; connecting again. Nothing is lost." : "Connecting …")
      : compiling ? progress.text : this.flights.number ? "Flying." : planning ? "Planning." : "Ready.";
    const text = this.message ? `${state} ${this.message}` : state;
    if (this.status.textContent !== text) this.status.textContent = text;
    const bar = document.getElementById("share");
    bar.hidden = !compiling || progress.share === null;
    if (!bar.hidden) bar.value = progress.share;
    document.getElementById("name").textContent = `${scenario.name ?? "not saved"}${scenario.changed ? " *" : ""}`;
    const reason = this._whyNotFly(), fly = document.getElementById("fly");
    fly.disabled = reason !== "";
    fly.title = reason || (this.flights.number ? "Stop the flight" : "Fly the plan");
    this._wait();
  }

  /** Why nothing can be flown, in a sentence; empty if it can. */
  _whyNotFly() {
    if (!this.connection.open) return "No connection to the server.";
    if (this.flights.number) return "";
    if (this.invalid) return "The scenario is not valid: the answer says why.";
    if (this.searching) return "No certified plan so far.";
    if (!this.answer) return "The first plan is being made.";
    return this.answer.status === "planned" ? "" : (isProven(this.answer) ? "No certified plan: the answer says why." : "No plan: the answer says why.");
  }

  _wait() {
    document.body.classList.toggle("late", this.requests.isLate && !this.told);
    const seconds = this.requests.flying ? (performance.now() - this.requests.since) / 1000 : 0;
    if (seconds > 0.3 && this.connection.open && this.status.textContent === "Ready.") this.report();
    this.waited.textContent = seconds > 1 ? `since ${seconds.toFixed(0)} s` : "";
  }

  /** Step through the entries of a recorded page. */
  _startRecording(at) {
    const slider = at("entry"), { recording } = this;
    document.body.classList.add("recorded");
    at("recorded").hidden = false;
    slider.max = String(recording.length - 1);
    const show = (k) => {
      const entry = recording[k];
      slider.value = String(k);
      slider.setAttribute("aria-valuetext", entry.label);
      at("entry-label").textContent = `${k + 1} of ${recording.length}: ${entry.label}`;
      at("previous").disabled = k === 0;
      at("next").disabled = k === recording.length - 1;
      this.scenario.table = entry.scenario;
      Object.assign(this, { answer: null, certified: null });
      recording.slice(0, k + 1).forEach((one) => this._take(one.answer)); // the last certified plan is that of an entry before
      this.drawNow();
    };
    slider.addEventListener("input", () => show(Number(slider.value)));
    at("previous").addEventListener("click", () => show(Number(slider.value) - 1));
    at("next").addEventListener("click", () => show(Number(slider.value) + 1));
    show(0);
    this.map.fit();
    document.documentElement.dataset.ready = "1";
  }
}

window.live = new LivePage(JSON.parse(document.getElementById("live").textContent));
