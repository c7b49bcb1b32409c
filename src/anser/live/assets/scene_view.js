/* The report's 3-D scene, fed with the tracks of an answer. */
"use strict";

const SCENE_PAUSE_MS = 150, SCENE_STEP_MS = 60, SCENE_TIMES = 200, NO_EVENTS = { renewals: [], phases: [], limited: [], outside: [], failed: [] };

/** Value of a line at a time, between its points; the last value after the end. */
function interpolated(times, values, time) {
  if (time >= times.at(-1)) return values.at(-1);
  let j = 1;
  while (times[j] < time) j++;
  const value = values[j - 1] + ((time - times[j - 1]) / (times[j] - times[j - 1])) * (values[j] - values[j - 1]);
  return Number.isFinite(value) ? value : values[j - 1];
}

/** Attitude quaternion (north, east, down to body) of Euler angles, rad. */
function quaternionOf(roll, pitch, yaw) {
  const [cr, sr, cp, sp, cy, sy] = [roll, pitch, yaw].flatMap((angle) => [Math.cos(angle / 2), Math.sin(angle / 2)]);
  return [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy];
}

/**
 * A run, as the report's scene draws it, of the tracks of a fleet. The rendezvous moves with its goal, by which it was planned
 * without the events; `rendezvous_s` is its time where the track goes on after it.
 */
function runOf(fleet, page, events) {
  const { scenario } = page;
  const answer = { aircraft: fleet };
  const end = Math.max(1, ...answer.aircraft.map((one) => one.track.time_s.at(-1) ?? 0)), goals = new Map(scenario.list("goal").map((goal) => [goal.name, goal]));
  const time = Float64Array.from({ length: SCENE_TIMES }, (_, j) => (end * j) / (SCENE_TIMES - 1));
  const names = ["", "reference_", "goal_", "rendezvous_"].flatMap((prefix) => ["north_m", "east_m", "altitude_m"].map((axis) => prefix + axis)).concat([0, 1, 2, 3].map((n) => `quaternion_${n}`));
  const cache = new Map(names.map((name) => [name, answer.aircraft.map(() => new Float64Array(SCENE_TIMES).fill(NaN))]));
  answer.aircraft.forEach((one, k) => {
    const put = (name, value, j) => { cache.get(name)[k][j] = value; }, { track, rendezvous } = one, goal = goals.get(one.goal), last = track.time_s.at(-1) ?? 0;
    const then = goal && motionAt(goal, one.rendezvous_s ?? last);
    for (let j = 0; j < SCENE_TIMES; j++) {
      const at = goal && motionAt(goal, time[j], events);
      for (const axis of ["north_m", "east_m", "altitude_m"]) {
        if (time[j] <= last + end / SCENE_TIMES) put(axis, interpolated(track.time_s, track[axis], time[j]), j);
        if (at) {
          put(`goal_${axis}`, at[axis], j);
          put(`rendezvous_${axis}`, at[axis] + rendezvous[axis] - then[axis], j);
        }
      }
      const ahead = ["north_m", "east_m", "altitude_m"].map((axis) => interpolated(track.time_s, track[axis], Math.min(last, time[j] + 1)) - interpolated(track.time_s, track[axis], Math.min(last - 1, time[j])));
      const bank = radians(interpolated(track.time_s, track.bank_deg, time[j]) || 0);
      quaternionOf(bank, Math.atan2(ahead[2], Math.hypot(ahead[0], ahead[1])), Math.atan2(ahead[1], ahead[0])).forEach((value, n) => put(`quaternion_${n}`, value, j));
    }
  });
  const form = ({ kind, speed_m_s: speed = 0 } = {}) => (kind === "surface" ? (speed > 1 ? "ship" : "buoy") : kind === "airborne" ? (speed > 30 ? "flying" : "drifting") : "goal");
  const aircraft = answer.aircraft.map((one, index) => ({
    name: one.name, goal: one.goal, index, form: form(goals.get(one.goal)), arrival_s: one.arrival_s ?? null, planned_arrival_s: one.arrival_s ?? null, goals: [[one.goal, 0]], get color() { return Theme.ink(page.hueOf(one.name)); },
  }));
  const keepOuts = page.keepOuts().map(({ table, from }) => ({ bottom_m: 0, top_m: 15240, speed_m_s: 0, course_deg: 0, from_s: from, ...table }));
  const variables = Object.fromEntries(names.map((name) => [name, { unit: "m" }]));
  return Object.assign(Object.create(Run.prototype), { aircraft, variables, cache, time, times: SCENE_TIMES, end, keepOuts, events: aircraft.map(() => NO_EVENTS) });
}

/** The aircraft of an answer with their flown tracks; the bank angles are those of the plan. */
function flownFleet(fleet, flight) {
  return fleet.filter(({ name }) => flight.names.includes(name)).map((one) => {
    const k = flight.names.indexOf(one.name), left = flight.north_m[k].findIndex((value) => !Number.isFinite(value)), count = left < 0 ? flight.time_s.length : left, time_s = flight.time_s.slice(0, count);
    const axes = Object.fromEntries(["north_m", "east_m", "altitude_m"].map((axis) => [axis, flight[axis][k].slice(0, count)]));
    return { ...one, rendezvous_s: one.track.time_s.at(-1), track: { ...axes, time_s, bank_deg: time_s.map((time) => (time > one.track.time_s.at(-1) ? 0 : interpolated(one.track.time_s, one.track.bank_deg, time))) } };
  }).filter(({ track }) => track.time_s.length > 1);
}

class SceneView {
  constructor(place, page) {
    Object.assign(this, { place, page, timer: 0 });
  }

  /** Draw the answer after a pause without a newer answer; a flight that is played moves at once. */
  draw() {
    const { playedTime } = this.page;
    if (playedTime !== null && this.state && performance.now() - (this.moved ?? 0) > SCENE_STEP_MS) {
      this.moved = performance.now();
      this.state.setTime(Math.min(playedTime, this.state.end));
    }
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this._draw(), SCENE_PAUSE_MS);
  }

  _draw() {
    const { answer, scenario, playedTime, requests, flight, flights } = this.page;
    if (requests.flying || requests.due) {
      this.draw(); // the scene would delay the plans of a drag
      return;
    }
    const whole = flight?.time_s.length && playedTime !== null && !flights.number ? flight : null; // flown to its end
    if (!answer?.drawn.length || !this.place.clientHeight || this.broken) return;
    if (answer !== this.shown || whole !== this.flown) {
      Object.assign(this, { shown: answer, flown: whole });
      const run = whole ? runOf(flownFleet(answer.drawn, whole), this.page, scenario.list("event")) : runOf(answer.drawn, this.page, []), frame = frameOf([run]), lift = liftOf(frame.box);
      if (this.scene) this._replace(run, frame, lift);
      else this._make(run, frame, lift);
    }
    this.state?.setTime(playedTime ?? 0.5 * this.state.end);
  }

  _make(run, frame, lift) {
    this.state = new State([run]);
    this.middle = frame.middle;
    try {
      this.scene = new FlightScene(run, this.state, frame, { plans: false }, lift);
      this.place.append(this.scene.root);
    } catch (error) {
      this.broken = true;
      this.place.append(element("p", "lacking", `No 3-D scene: this browser offers no WebGL (${error.message}).`));
    }
  }

  _replace(run, frame, lift) {
    const names = run.aircraft.map((one) => one.name), { state } = this;
    Object.assign(state, { runs: [run], end: run.end, names, focus: names.includes(state.focus) ? state.focus : names[0] });
    this.scene.replace(run, frame, lift);
  }
}
