/* The answer: verdict, reasons of a refusal, margins, arrivals on a common axis, closest pair. */
"use strict";

const BARS_SHOWN = 10;
/** Utilization of a limit, 1 at the limit; NaN without a value, infinite (null in an answer) beyond a limit of the other sign. */
const utilizationOf = ({ utilization, bound }) => utilization ?? (bound === null ? NaN : Infinity);
const HEADS = { planned: "Certified plan", refused: "No certified plan", invalid: "Not a valid scenario", searching: "No certified plan so far" };

/** Heads of the answers of a planner that proves nothing. */
const UNPROVEN_HEADS = { planned: "Plan, not certified", refused: "No plan" };
/** Whether the planner of an answer proves limits, separation and keep-outs; recorded answers without the entry do. */
const isProven = (answer) => answer?.certified !== false;

class AnswerPanel {
  constructor(place, page) {
    Object.assign(this, { place, page });
    this.all = false;
  }

  draw() {
    const { answer, problems, invalid, searching } = this.page, status = invalid ? "invalid" : searching ? "searching" : answer?.status;
    if (!status) return;
    const proven = isProven(answer), isGood = status === "planned" && proven;
    const box = element("div", `answer ${isGood ? "good" : status === "refused" ? "bad" : "mixed"}`), spoken = (proven ? null : UNPROVEN_HEADS[status]) ?? HEADS[status];
    box.append(element("p", "head", spoken), ...problems.map((problem) => this._problem(problem)));
    if (searching) box.append(element("p", "note", "Further kinds of paths are being tried."));
    else for (const note of answer?.notes || []) box.append(element("p", "note", note));
    if (status === "planned" && !proven) box.append(element("p", "note", "The limits are kept at samples; this planner plans no separation and no keep-outs."));
    if (status === "planned") {
      const first = answer.first_s, last = answer.last_s;
      box.append(element("p", "note", Math.abs(last - first) < 0.005 ? `All arrive at ${printed(first, 2)} s.` : `Arrivals from ${printed(first, 2)} s to ${printed(last, 2)} s.`));
    } else if (answer?.aircraft.length) box.append(element("p", "note", status !== "refused" ? "Grey: the last answer." : this._lines(answer)));
    const parts = [element("p", "waits", "The scenario has changed: planning again. Below: the plan of the scenario before."), box];
    if (answer?.aircraft.length) parts.push(...this._arrivals(answer), ...this._closest(answer), ...this._margins(answer.drawn));
    const at = this.place.scrollTop;
    const focused = this.place.contains(document.activeElement) ? document.activeElement.dataset.jump : null;
    this.place.replaceChildren(...parts);
    if (focused) this.place.querySelector(`[data-jump="${CSS.escape(focused)}"]`)?.focus();
    this.place.scrollTop = at;
    this.place.classList.toggle("stale", this.page.isStale);
  }

  /** What the lines of a refusal are, in words. */
  _lines({ aircraft, drawn }) {
    const hidden = aircraft.filter((one) => one.drawn === false).map((one) => one.name);
    return [drawn.length ? "Dashed: the best attempt, not proven." : "", hidden.length ? `No attempt of ${hidden.join(", ")} is near its limits; none is drawn.` : "", this.page.certified ? `Faint: the last ${isProven(this.page.certified) ? "certified plan" : "plan"}.` : ""].filter(Boolean).join(" ");
  }

  /** A sentence, followed by links to the inputs that it is about. */
  _problem(problem) {
    const empty = problem.keys.map((key) => this.page.inputs.emptyAt(key)).find(Boolean), line = element("p", "problem", empty ? `The field “${empty}” is empty. ${problem.text}` : problem.text);
    for (const key of problem.keys.filter((one) => this.page.inputs.fieldOf(one))) {
      const button = element("button", "jump", `→ ${this.page.nameOfKey(key)}`);
      button.type = "button";
      button.dataset.jump = key;
      button.addEventListener("click", () => this.page.jump(key));
      line.append(" ", button);
    }
    return line;
  }

  _arrivals({ aircraft }) {
    const known = aircraft.filter((one) => Number.isFinite(one.arrival_s));
    if (!known.length) return [];
    const times = known.map((one) => one.arrival_s), low = Math.min(...times), high = Math.max(...times), room = Math.max(2, 0.15 * (high - low));
    const list = element("ol", "arrivals");
    for (const one of known) {
      const row = element("li"), name = element("span", "name", one.name), axis = element("span", "axis"), mark = element("i");
      mark.style.left = `${(100 * (one.arrival_s - low + room)) / (high - low + 2 * room)}%`;
      mark.style.background = this.page.colorOf(one.name);
      axis.append(mark);
      row.append(name, axis, element("span", "share", `${printed(one.arrival_s, 1)} s`));
      row.title = `${one.name} to ${one.goal}: ${one.path}, ${printed(one.length_m, 0)} m, ${printed(one.speed_mean_m_s, 1)} m/s`;
      list.append(row);
    }
    return [element("h2", "", "Arrivals"), list];
  }

  _closest({ separation, keep_outs: keepOuts }) {
    const lines = [];
    if (separation?.pair) {
      const { pair, distances_m, required_m } = separation, [lengths, required] = [distances_m, required_m].map((list) => list.map((length) => `${printed(length, 0)} m`));
      const distance = required.length ? lengths.map((length, k) => `${length} in ${["the plane", "altitude"][k]}`).join(" and ") : lengths[0];
      const needed = required.length ? `, ${required.join(" or ")} required` : "";
      lines.push(element("p", separation.is_met ? "fact" : "fact over", `Closest pair: ${pair.join(" and ")}, ${distance} at ${printed(separation.time_s, 1)} s${needed}.`));
    }
    for (const one of keepOuts || []) lines.push(element("p", one.clearance_m < 0 ? "fact over" : "fact", `Keep-out ${one.name}: ${printed(one.clearance_m, 0)} m clear of ${one.aircraft ?? "all"}.`));
    return lines.length ? [element("h2", "", "Clearance"), ...lines] : [];
  }

  /** Bars of the limits, the fullest first. */
  _margins(aircraft) {
    const rows = aircraft.flatMap((one) => one.limits.map((limit) => ({ one, limit }))).map((row) => ({ ...row, share: utilizationOf(row.limit) })).filter(({ share }) => !Number.isNaN(share));
    rows.sort((a, b) => (a.share === b.share ? 0 : b.share - a.share));
    const shown = this.all ? rows : rows.slice(0, BARS_SHOWN), list = element("ul", "bars");
    for (const { one, limit, share } of shown) {
      const row = element("li", share > 1 + 1e-6 ? "over" : share > 0.9 ? "near" : ""), bar = element("span", "bar"), fill = element("i");
      fill.style.width = `${Math.min(100, Math.max(0, 100 * share))}%`;
      bar.append(fill);
      const swatch = element("span", "swatch"), name = element("span", "name");
      swatch.style.background = this.page.colorOf(one.name);
      name.append(swatch, `${limit.label}`);
      row.append(name, bar, element("span", "share", `${printed(limit.bound ?? limit.planned, 1)} ${limit.is_least ? "(at least" : "of"} ${`${printed(limit.limit, 1)} ${limit.unit}`.trim()}${limit.is_least ? ")" : ""}`));
      row.title = `${one.name}: ${limit.label} ${printed(limit.planned)} ${limit.unit}, bound ${printed(limit.bound)} ${limit.unit}, limit ${printed(limit.limit)} ${limit.unit}`;
      list.append(row);
    }
    const parts = [element("h2", "", "Limits"), list];
    if (rows.length > BARS_SHOWN) {
      const more = element("button", "plain", this.all ? "fewer" : `${rows.length - BARS_SHOWN} more`);
      more.type = "button";
      more.dataset.jump = "more";
      more.addEventListener("click", () => { this.all = !this.all; this.draw(); });
      parts.push(more);
    }
    return rows.length ? parts : [];
  }
}
