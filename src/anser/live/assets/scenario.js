/* The scenario that the page edits: plain data as in a scenario file, with undo, redo and a copy in the tab's storage. */
"use strict";

const HISTORY_MAX = 100, STORED_MAX = 20, MERGE_MS = 800;

/** Parts of a key path: "aircraft[1].start.north_m" gives ["aircraft", 1, "start", "north_m"]. */
function keyParts(path) {
  return (path.match(/[^.[\]]+/g) || []).map((part) => (/^\d+$/.test(part) ? Number(part) : part));
}

/** The tab's storage. A full or forbidden storage keeps nothing, and the page works without. */
const TabStorage = {
  get(key) {
    try { return sessionStorage.getItem(key); } catch { return null; }
  },
  set(key, text) {
    try { sessionStorage.setItem(key, text); } catch { /* nothing is kept */ }
  },
};

/** Value at a key path, or undefined. */
function valueAt(table, path) {
  return keyParts(path).reduce((value, part) => value?.[part], table);
}

class Scenario {
  constructor() {
    Object.assign(this, { table: null, name: null, undone: [], done: [], merge: null, changed: false });
    this.listeners = [];
    this.storageKey = `anser-live ${location.pathname}`;
  }

  /** Register a function that is called after each change with the time stamp of the event behind it. */
  on(listener) {
    this.listeners.push(listener);
  }

  _tell(stamp) {
    this.listeners.forEach((listener) => listener(stamp));
  }

  get(path) {
    return valueAt(this.table, path);
  }

  number(path, otherwise) {
    const value = this.get(path);
    return typeof value === "number" ? value : otherwise;
  }

  list(key) {
    return Array.isArray(this.table?.[key]) ? this.table[key] : [];
  }

  /** Replace the whole scenario by that of a file; the history begins anew. */
  open(table, name) {
    Object.assign(this, { table, name, undone: [], done: [], merge: null, changed: false });
    this.store();
    this._tell(performance.now());
  }

  /** A scenario has been written, as this text, to a file of this name; the present one may have changed since. */
  saved(name, text) {
    Object.assign(this, { name, changed: JSON.stringify(this.table) !== text });
    this.store();
    this._tell(performance.now());
  }

  /**
   * Change the scenario by a function. Changes with the same `merge` key in quick succession, or within a drag (`held`),
   * are a single step of the history.
   */
  edit(change, { merge = null, held = false, stamp = performance.now() } = {}) {
    const now = performance.now(), before = JSON.stringify(this.table);
    change(this.table);
    if (JSON.stringify(this.table) === before) return;
    const same = merge !== null && this.merge?.key === merge && (this.merge.held || now - this.merge.time < MERGE_MS);
    if (!same) this.done.push(before);
    this.merge = { key: merge, time: now, held };
    if (this.done.length > HISTORY_MAX) this.done.shift();
    this.undone.length = 0;
    this.changed = true;
    if (!held) this.store();
    this._tell(stamp);
  }

  /** Make several changes a single step of the history. */
  together(changes) {
    const done = [...this.done], before = JSON.stringify(this.table);
    changes();
    this.done = [...done, before].slice(-HISTORY_MAX);
    this.store();
  }

  /** Set the value at a key path; undefined removes the key. */
  set(path, value, options) {
    const parts = keyParts(path), last = parts.pop();
    this.edit((table) => {
      let target = table;
      for (const part of parts) target = target[part] ??= {};
      if (value === undefined) delete target[last];
      else target[last] = value;
    }, { merge: path, ...options });
  }

  /** A drag has ended: the next change is a step of its own. */
  release() {
    if (this.merge) this.merge = null;
    this.store();
  }

  undo() {
    this._step(this.done, this.undone);
  }

  redo() {
    this._step(this.undone, this.done);
  }

  _step(from, to) {
    if (!from.length) return;
    to.push(JSON.stringify(this.table));
    this.table = JSON.parse(from.pop());
    this.merge = null;
    this.changed = true;
    this.store();
    this._tell(performance.now());
  }

  /** Name that no table of a list has yet, after the name of the last: "goal-3", or "boat-3" after "boat-2". */
  _freeName(key) {
    const names = new Set(this.list(key).map((table) => table.name)), stem = this.list(key).at(-1)?.name?.match(/^(.+)-\d+$/)?.[1] ?? key.replace("_", "-");
    let k = names.size + 1;
    while (names.has(`${stem}-${k}`)) k++;
    return `${stem}-${k}`;
  }

  /** Add a table to a list of tables, from a template. Returns its index. */
  add(key, template) {
    const table = structuredClone(template);
    table.name = this._freeName(key);
    this.edit((scenario) => {
      (scenario[key] ??= []).push(table);
      if (key === "aircraft") scenario.arrival?.order?.push(table.name);
    });
    return this.list(key).length - 1;
  }

  /** Remove a table of a list; aircraft of a removed goal fly to the first goal that is left. */
  remove(key, k) {
    const { name } = this.list(key)[k];
    this.edit((scenario) => {
      scenario[key].splice(k, 1);
      if (!scenario[key].length) delete scenario[key];
      const otherwise = scenario.goal?.[0]?.name;
      if (key === "goal" && otherwise) (scenario.aircraft || []).filter((one) => one.goal === name).forEach((one) => { one.goal = otherwise; });
      if (key === "aircraft" && scenario.arrival?.order) scenario.arrival.order = scenario.arrival.order.filter((one) => one !== name);
      const about = (table) => name !== undefined && table[key] === name; // an event has no name
      for (const list of ["event", "gust", "excitation"]) {
        if (!scenario[list]) continue;
        scenario[list] = scenario[list].filter((table) => !about(table));
        if (!scenario[list].length) delete scenario[list];
      }
    });
  }

  /** Rename an aircraft, a goal or a keep-out, and every mention of its name. Returns whether no other one has the name. */
  rename(key, k, name) {
    const before = this.list(key)[k].name;
    if (name === before) return true;
    if (this.list(key).some((table) => table.name === name)) return false;
    this.edit((scenario) => {
      scenario[key][k].name = name;
      const mention = key === "keep_out" ? null : key;
      for (const list of mention ? ["aircraft", "event", "gust", "excitation"] : []) {
        for (const table of scenario[list] || []) if (table[mention] === before) table[mention] = name;
      }
      if (key === "aircraft" && scenario.arrival?.order) scenario.arrival.order = scenario.arrival.order.map((one) => (one === before ? name : one));
    });
    return true;
  }

  /** Copy the document into the tab's storage, so that a reload loses nothing. */
  store() {
    if (!this.table) return;
    const { table, name, changed } = this;
    TabStorage.set(this.storageKey, JSON.stringify({ table, name, changed, done: this.done.slice(-STORED_MAX), undone: this.undone.slice(-STORED_MAX) }));
  }

  /** Return to the document that the tab's storage holds. Returns whether there is one. */
  restore() {
    const stored = JSON.parse(TabStorage.get(this.storageKey));
    if (!stored?.table) return false;
    Object.assign(this, stored);
    return true;
  }
}

/**
 * Motion of a goal or keep-out at a time by its table, with the events that turn or stop a goal: north, east and altitude (m),
 * speed over the ground (m/s), course (deg) and climb rate (m/s).
 */
function motionAt(table, time, events = []) {
  const turns = events.filter((event) => event.goal === table.name && ["goal-turns", "goal-stops"].includes(event.kind) && event.time_s <= time);
  turns.sort((a, b) => a.time_s - b.time_s);
  let motion = ownMotion(table, turns[0]?.time_s ?? time);
  turns.forEach((event, k) => {
    if (event.kind === "goal-stops") Object.assign(motion, { speed_m_s: 0, climb_rate_m_s: 0 });
    else Object.assign(motion, { speed_m_s: event.speed_m_s ?? motion.speed_m_s, course_deg: event.course_deg || 0 });
    motion = ahead(motion, (turns[k + 1]?.time_s ?? time) - event.time_s);
  });
  return motion;
}

/** Motion at a time by the table alone: straight, or from waypoint to waypoint, at rest after the last one. */
function ownMotion(table, time) {
  const { waypoints } = table;
  if (!waypoints?.length) return ahead({ north_m: table.north_m, east_m: table.east_m, altitude_m: table.altitude_m || 0, speed_m_s: table.speed_m_s || 0, course_deg: table.course_deg || 0, climb_rate_m_s: table.climb_rate_m_s || 0 }, time);
  const k = Math.max(0, waypoints.findLastIndex((point) => point.time_s <= time)), here = waypoints[k], next = waypoints[k + 1] ?? here, span = next.time_s - here.time_s;
  const rate = (axis) => (span > 0 ? ((next[axis] || 0) - (here[axis] || 0)) / span : 0), north = rate("north_m"), east = rate("east_m");
  const motion = { north_m: here.north_m, east_m: here.east_m, altitude_m: here.altitude_m || 0, speed_m_s: Math.hypot(north, east), course_deg: degrees(Math.atan2(east, north)), climb_rate_m_s: rate("altitude_m") };
  return ahead(motion, Math.max(0, time - here.time_s));
}

/** A straight motion after a duration, s. */
function ahead(motion, duration) {
  const course = radians(motion.course_deg), way = motion.speed_m_s * duration;
  return { ...motion, north_m: motion.north_m + way * Math.cos(course), east_m: motion.east_m + way * Math.sin(course), altitude_m: motion.altitude_m + motion.climb_rate_m_s * duration };
}
