/* The socket to the server: reconnection, numbered requests, and one plan request at a time. */
"use strict";

const BACK_OFF_MS = [300, 600, 1200, 2500, 5000], CONNECT_MS = 20000, RESEND_MS = 250, LATE_MS = 700, LATENCIES_MAX = 500;

class Connection {
  constructor() {
    // A page that was loaded anew numbers its requests above those of the page before, whose answers may come late.
    const number = 1000 * Date.now();
    Object.assign(this, { number, attempts: 0, open: false, listeners: {}, waiting: new Map() });
    addEventListener("online", () => this._hurry());
    document.addEventListener("visibilitychange", () => { if (!document.hidden) this._hurry(); });
  }

  on(type, listener) {
    this.listeners[type] = listener;
  }

  start() {
    const address = new URL("socket", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    address.search = address.hash = "";
    const socket = new WebSocket(address), patience = setTimeout(() => socket.close(), CONNECT_MS);
    this.socket = socket;
    socket.addEventListener("open", () => {
      clearTimeout(patience);
      const again = this.opened;
      Object.assign(this, { open: true, opened: true, attempts: 0 });
      this.listeners.open?.(again);
    });
    socket.addEventListener("message", (event) => this._receive(JSON.parse(event.data)));
    socket.addEventListener("close", () => {
      clearTimeout(patience);
      if (this.socket !== socket) return;
      this.open = false;
      const delay = BACK_OFF_MS[Math.min(this.attempts++, BACK_OFF_MS.length - 1)];
      this.waiting.clear();
      this.listeners.closed?.(delay);
      this.timer = setTimeout(() => { this.timer = 0; this.start(); }, delay);
    });
  }

  /** Connect at once if an attempt is due later. */
  _hurry() {
    if (!this.timer) return;
    clearTimeout(this.timer);
    this.timer = 0;
    this.start();
  }

  _receive(message) {
    const reply = this.waiting.get(message.number);
    if (reply && message.type !== "progress" && message.type !== "rows") {
      this.waiting.delete(message.number);
      reply(message);
    } else this.listeners[message.type]?.(message);
  }

  /** Send a request; `reply` gets the answer to it. Returns its number, or 0 without a connection. */
  send(type, content = {}, reply = null) {
    if (!this.open) return 0;
    const number = ++this.number;
    if (reply) this.waiting.set(number, reply);
    this.socket.send(JSON.stringify({ type, number, ...content }));
    return number;
  }
}

/** Plan requests: the newest scenario is sent when the former answer has arrived, or when it is late; after a drag always. */
class PlanRequests {
  constructor(connection, scenario) {
    Object.assign(this, { connection, scenario, flying: 0, sent: 0, since: 0, due: false, late: 0, usual: 0, answered: 0, changed: 0 });
    this.stamps = new Map(); // number of a request: time stamp of the newest event in its scenario
  }

  /** The scenario has changed by an event with this time stamp. */
  ask(stamp) {
    this.stamp = stamp;
    this.due = true;
    this.changed ||= performance.now();
    this._try();
  }

  /** A drag has ended: a scenario that has not been sent replaces the one that is being planned. */
  finish() {
    if (this.due) this._send(true);
  }

  _try() {
    if (!this.due) return;
    // a new request cancels the former on the server: a drag must not cancel plans that take longer than the usual wait
    const rest = Math.max(RESEND_MS, 1.5 * this.usual) - (performance.now() - this.since);
    if (!this.flying || rest <= 0) this._send();
    else if (!this.late) this.late = setTimeout(() => { this.late = 0; this._try(); }, rest);
  }

  _send(final = false) {
    this.number = this.connection.send("plan", { scenario: this.scenario.table, final });
    if (!this.number) return; // asked again after the reconnection
    this.due = false;
    this.flying = this.number;
    this.since = performance.now();
    this.stamps.set(this.number, this.stamp);
    for (const number of this.stamps.keys()) if (this.stamps.size > 8) this.stamps.delete(number);
  }

  /** Record the answer to a request. Returns whether it is newer than the answers before it. */
  answer(number) {
    if (number < this.answered) return false;
    this.answered = number;
    if (number === this.flying) {
      this.usual = 0.5 * (this.usual + Math.min(2000, performance.now() - this.since));
      this.flying = 0;
      this.changed = this.due ? performance.now() : 0;
      this._try();
    }
    return true;
  }

  /** Whether the newest scenario waits so long for its answer that the answer shown would be taken for it. */
  get isLate() {
    return this.changed > 0 && performance.now() - this.changed > LATE_MS;
  }

  /** The connection is cut: nothing is on its way. */
  reset() {
    this.flying = 0;
    this.usual = 0;
    this.changed = 0;
  }
}

/** Times from a pointer or key event to the painted frame with the plan for it, ms; the newest. */
class Latencies extends Array {
  /** Measure until the frame in which the present drawing is painted. */
  measure(number, stamp, elapsed_ms) {
    requestAnimationFrame(() => {
      const channel = new MessageChannel();
      channel.port1.onmessage = () => {
        channel.port1.close();
        const latency_ms = performance.now() - stamp;
        performance.mark("plan painted", { detail: { number, latency_ms } });
        performance.clearMarks("plan painted");
        this.push({ number, latency_ms, elapsed_ms });
        if (this.length > LATENCIES_MAX) this.shift();
      };
      channel.port2.postMessage(null);
    });
  }
}
