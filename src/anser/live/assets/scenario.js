/* The scenario that the page edits: plain data as in a scenario file, with undo, redo and a copy in the tab's storage. */
"use strict";

const HISTORY_MAX = 100, STORED_MAX = 20, MERGE_MS = 800;

/** Parts of a key path: "aircraft[1].start.north_m" gives ["aircraft", 1, "start", "north_m"]. */
function keyParts(path) {
  return (path.match(/[^.[\]]+/g) || []).map((part) => (/^\d+$/.test(part) ? Number(part) : part));
}

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

  /** The scenario has been written to a file of this name. */
  saved(name) {
    Object.assign(this, { name, changed: false });
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
    const before = this.done.length;
    changes();
    this.done.splice(before + 1);
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
      const about = (table) => table[key] === name;
      for (const list of ["event", "gust", "excitation"]) {
        if (!scenario[list]) continue;
        scenario[list] = scenario[list].filter((table) => !about(table));
        if (!scenario[list].length) delete scenario[list];
      }
    });
  }

  /** Rename an aircraft, a goal or a keep-out, and every mention of its name. */
  rename(key, k, name) {
    const before = this.list(key)[k].name;
    if (name === before) return;
    this.edit((scenario) => {
      scenario[key][k].name = name;
      const mention = key === "keep_out" ? null : key;
      for (const list of mention ? ["aircraft", "event", "gust", "excitation"] : []) {
        for (const table of scenario[list] || []) if (table[mention] === before) table[mention] = name;
      }
      if (key === "aircraft" && scenario.arrival?.order) scenario.arrival.order = scenario.arrival.order.map((one) => (one === before ? name : one));
    });
  }

  /** Copy the document into the tab's storage, so that a reload loses nothing. */
  store() {
    if (!this.table) return;
    const { table, name, changed } = this;
    try {
      sessionStorage.setItem(this.storageKey, JSON.stringify({ table, name, changed, done: this.done.slice(-STORED_MAX), undone: this.undone.slice(-STORED_MAX) }));
    } catch {
      // a full or forbidden storage: the page works without the copy
    }
  }

  /** Return to the document that the tab's storage holds. Returns whether there is one. */
  restore() {
    try {
      const stored = JSON.parse(sessionStorage.getItem(this.storageKey));
      if (!stored?.table) return false;
      Object.assign(this, stored);
      return true;
    } catch {
      return false;
    }
  }
}

/** Position of a goal or keep-out at a time by its tables, with the events that turn or stop a goal; north, east, altitude, m. */
function positionAt(table, time, events = []) {
  const { waypoints } = table;
  const turns = events.filter((event) => event.goal === table.name && ["goal-turns", "goal-stops"].includes(event.kind) && event.time_s < time);
  if (turns.length) {
    const event = turns.reduce((late, one) => (one.time_s >= late.time_s ? one : late)), before = events.filter((one) => one !== event && one.time_s <= event.time_s);
    const from = positionAt(table, event.time_s, before);
    if (event.kind === "goal-stops") return from;
    const earlier = positionAt(table, Math.max(0, event.time_s - 1), before), speed = Math.hypot(from.north_m - earlier.north_m, from.east_m - earlier.east_m);
    return ahead(from, (waypoints ? speed : table.speed_m_s) || 0, event.course_deg || 0, time - event.time_s, (waypoints ? 0 : table.climb_rate_m_s) || 0);
  }
  if (!waypoints) return ahead({ altitude_m: 0, ...table }, table.speed_m_s || 0, table.course_deg || 0, time, table.climb_rate_m_s || 0);
  const k = waypoints.findLastIndex((point) => point.time_s <= time), here = waypoints[Math.max(0, k)], next = waypoints[k + 1];
  const part = k >= 0 && next ? (time - here.time_s) / (next.time_s - here.time_s) : 0;
  const value = (axis) => (here[axis] || 0) + part * ((next || here)[axis] - here[axis] || 0);
  return { north_m: value("north_m"), east_m: value("east_m"), altitude_m: value("altitude_m") };
}

function ahead({ north_m, east_m, altitude_m }, speed, course_deg, time, climb) {
  const course = (course_deg * Math.PI) / 180;
  return { north_m: north_m + speed * time * Math.cos(course), east_m: east_m + speed * time * Math.sin(course), altitude_m: (altitude_m || 0) + climb * time };
}
