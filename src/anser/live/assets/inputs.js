/* Inputs that edit what the map edits: aircraft, goals, keep-outs, sliders, arrival rule. */
"use strict";

const AIRCRAFT_FIELDS = [["start.north_m", "North", "m"], ["start.east_m", "East", "m"], ["start.altitude_m", "Altitude", "m"], ["start.speed_m_s", "Speed", "m/s"], ["start.course_deg", "Course", "°"],
  ["rendezvous.stand_off_up_m", "Above the goal", "m", 300]];
const ARRIVAL_FIELDS = { times: [["arrive_s", "Arrival", "s"]], windows: [["arrive_from_s", "Arrival from", "s"], ["arrive_to_s", "Arrival to", "s"]] };
const GOAL_FIELDS = [["north_m", "North", "m"], ["east_m", "East", "m"], ["altitude_m", "Altitude", "m", 0], ["speed_m_s", "Speed", "m/s", 0], ["course_deg", "Course", "°", 0]];
const WAYPOINT_FIELDS = [["time_s", "Time", "s"], ["north_m", "North", "m"], ["east_m", "East", "m"], ["altitude_m", "Altitude", "m", 0]];
const KEEP_OUT_FIELDS = [["north_m", "North", "m"], ["east_m", "East", "m"], ["radius_m", "Radius", "m"], ["bottom_m", "Bottom", "m", 0], ["top_m", "Top", "m", 15240]];
const LISTS = { aircraft: ["Aircraft", "aircraft"], goal: ["Goals", "goal"], keep_out: ["Keep-outs", "keep-out"] };

class Inputs {
  constructor(place, page) {
    Object.assign(this, { place, page, fields: new Map(), names: new Map(), opened: new Set() });
  }

  /** Build the inputs anew where their number or kind has changed; show the values. */
  draw() {
    const { scenario, welcome } = this.page;
    const shape = JSON.stringify([["aircraft", "goal", "keep_out"].map((key) => scenario.list(key).map((one) => [one.name, one.kind, one.waypoints?.length])), scenario.get("arrival.rule"), welcome?.sliders.map(({ key }) => key), this.page.fixed]);
    if (shape !== this.shape) {
      this.shape = shape;
      this._build();
    }
    this.fields.forEach((field) => { if (document.activeElement !== field.input || field.input.type === "range" || !field.typed) field.show(); });
    this._mark();
  }

  _build() {
    const { welcome } = this.page, focused = document.activeElement?.dataset?.path;
    this.fields.clear();
    this.names.clear();
    const parts = Object.keys(LISTS).map((key) => this._list(key));
    if (welcome) parts.push(this._rule(welcome.rules), this._sliders(welcome.sliders));
    const fieldset = element("fieldset");
    fieldset.disabled = this.page.fixed;
    fieldset.append(...parts);
    this.place.replaceChildren(fieldset);
    if (focused) this.fields.get(focused)?.input.focus();
  }

  _list(key) {
    const { scenario, welcome, page } = { ...this.page, page: this.page, scenario: this.page.scenario }, [title, noun] = LISTS[key], group = element("section"), head = element("div", "list-head");
    head.append(element("h2", "", title));
    if (welcome) {
      const add = element("button", "plain", "+ add");
      add.type = "button";
      add.setAttribute("aria-label", `Add ${noun}`);
      add.addEventListener("click", () => page.add(key));
      head.append(add);
      if (key === "aircraft") {
        const pair = element("button", "plain", "+ with a goal");
        pair.type = "button";
        pair.title = "an aircraft like the last one, with a goal of its own";
        pair.setAttribute("aria-label", "Add aircraft with a goal of its own");
        pair.addEventListener("click", () => page.add("pair"));
        head.append(pair);
      }
    }
    group.append(head, ...scenario.list(key).map((table, k) => this._entry(key, table, k, noun)));
    return group;
  }

  _entry(key, table, k, noun) {
    const { page } = this, path = `${key}[${k}]`, box = element("details"), summary = element("summary"), swatch = element("span", "swatch");
    swatch.style.background = key === "aircraft" ? page.colorOf(table.name) : key === "goal" ? "var(--goal)" : "var(--limit)";
    summary.append(swatch, table.name);
    summary.dataset.path = path;
    box.open = this.opened.has(path);
    box.addEventListener("toggle", () => { if (box.open) this.opened.add(path); else this.opened.delete(path); });
    summary.addEventListener("keydown", (event) => { if (event.key === "Delete" && !event.repeat) page.remove({ key, k }); });
    const body = element("div", "fields");
    body.append(this._name(key, table, k, noun));
    if (key === "aircraft") body.append(this._choice(`${path}.goal`, "Goal", () => page.scenario.list("goal").map((goal) => [goal.name, goal.name])));
    if (key === "goal" && page.welcome) body.append(this._choice(`${path}.kind`, "Kind", () => page.welcome.goal_kinds.map((kind) => [kind, kind])));
    const extra = ARRIVAL_FIELDS[page.scenario.get("arrival.rule")] || [];
    const fields = { aircraft: [...AIRCRAFT_FIELDS, ...extra], goal: table.waypoints ? [] : GOAL_FIELDS, keep_out: KEEP_OUT_FIELDS }[key];
    body.append(...fields.map(([name, label, unit, otherwise]) => this._number(`${path}.${name}`, label, unit, otherwise, table.name)));
    (table.waypoints || []).forEach((_, j) => body.append(element("p", "caption wide", `Waypoint ${j + 1}`), ...WAYPOINT_FIELDS.map(([name, label, unit, otherwise]) => this._number(`${path}.waypoints[${j}].${name}`, label, unit, otherwise, `${table.name}, waypoint ${j + 1}`))));
    const remove = element("button", "plain wide", `remove this ${noun}`);
    remove.type = "button";
    remove.addEventListener("click", () => page.remove({ key, k }));
    body.append(remove);
    box.append(summary, body);
    this.names.set(path, { text: table.name, input: summary });
    return box;
  }

  _label(text, unit, input, path, about = "") {
    const label = element("label");
    label.append(element("span", "", unit ? `${text} (${unit})` : text), input);
    input.dataset.path = path;
    this.names.set(path, { text: about ? `${about}, ${text.toLowerCase()}` : text, input });
    return label;
  }

  _name(key, table, k, noun) {
    const input = element("input"), path = `${key}[${k}].name`;
    Object.assign(input, { type: "text", value: table.name, maxLength: 60, autocomplete: "off" });
    input.addEventListener("change", () => {
      const name = input.value.trim(), { scenario } = this.page;
      if (scenario.rename(key, k, name)) return;
      input.value = scenario.get(path);
      this.page.say(`${input.value} keeps its name: another ${noun} has the name ${name}.`);
    });
    this.fields.set(path, { input, typed: true, show: () => { input.value = this.page.scenario.get(path) ?? ""; } });
    return this._label("Name", "", input, path, table.name);
  }

  /** Input of a number; an empty input leaves the key out. */
  _number(path, label, unit, otherwise, about) {
    const input = element("input"), { scenario } = this.page;
    Object.assign(input, { type: "number", step: "any" });
    if (otherwise !== undefined) input.placeholder = String(otherwise);
    const put = (event) => {
      if (input.value === "" && otherwise === undefined && event.type === "change") {
        show(); // a needed number keeps its value
        this.page.say(`${this.nameOfKey(path)}: the field was empty${input.value ? "; the value before stays" : " and needs a number"}.`);
      }
      if (input.value === "" && (otherwise === undefined || event.type !== "change")) return;
      scenario.set(path, input.value === "" ? undefined : Number(input.value), { stamp: event.timeStamp });
    };
    input.addEventListener("input", put);
    input.addEventListener("change", put);
    const show = () => { const value = scenario.get(path); input.value = value === undefined ? "" : String(value); };
    this.fields.set(path, { input, typed: true, show });
    return this._label(label, unit, input, path, about);
  }

  _choice(path, label, options, otherwise, change = (value, event) => this.page.scenario.set(path, value, event)) {
    const input = element("select"), { scenario } = this.page;
    input.append(...options().map(([value, text]) => Object.assign(element("option", "", text), { value })));
    input.addEventListener("change", (event) => change(input.value, { stamp: event.timeStamp }));
    this.fields.set(path, { input, show: () => { input.value = scenario.get(path) ?? otherwise; } });
    return this._label(label, "", input, path);
  }

  _rule(rules) {
    const group = element("section"), fields = element("div", "fields"), now = this.page.scenario.get("arrival.rule") ?? rules[0].value;
    const change = (rule, event) => {
      const { scenario, answer } = this.page, last_s = answer?.status === "planned" ? answer.last_s : null;
      const needed = rules.find((one) => one.value === rule).keys, others = rules.flatMap((one) => one.keys).filter((key) => !needed.includes(key));
      scenario.edit((table) => {
        const arrival = (table.arrival ??= {});
        arrival.rule = rule;
        for (const [owner, key] of others.map((path) => path.split("."))) {
          for (const one of owner === "arrival" ? [arrival] : scenario.list("aircraft")) delete one[key];
        }
        if (rule === "at" && last_s) arrival.time_s ??= Math.ceil(10 * last_s) / 10; // of the plan, which exists
      }, { merge: "arrival.rule", ...event });
    };
    fields.append(this._choice("arrival.rule", "Rule", () => rules.map(({ value, label }) => [value, label]), rules[0].value, change));
    fields.firstChild.className = "wide";
    for (const key of rules.find((rule) => rule.value === now)?.keys || []) if (key === "arrival.order") fields.append(this._order());
    else if (key.startsWith("arrival.")) fields.append(this._number(key, { "arrival.time_s": "Arrival", "arrival.spacing_s": "Spacing" }[key] ?? key, "s"));
    group.append(element("h2", "", "Arrival times"), fields);
    return group;
  }

  /** The order of the arrivals: each aircraft with a button that moves it before the one above. */
  _order() {
    const { scenario } = this.page, box = element("div", "wide"), list = element("ol", "order");
    const order = () => { const names = scenario.list("aircraft").map((one) => one.name), set = scenario.get("arrival.order") || []; return [...set.filter((name) => names.includes(name)), ...names.filter((name) => !set.includes(name))]; };
    const show = () => {
      const names = order(), key = JSON.stringify(names);
      if (list.dataset.shown === key) return;
      list.dataset.shown = key;
      list.replaceChildren(...names.map((name, k) => {
        const item = element("li"), swatch = element("span", "swatch"), earlier = element("button", "plain", "earlier");
        swatch.style.background = this.page.colorOf(name);
        Object.assign(earlier, { type: "button", disabled: k === 0 });
        earlier.setAttribute("aria-label", `${name} earlier`);
        earlier.addEventListener("click", () => {
          scenario.set("arrival.order", [...names.slice(0, k - 1), name, names[k - 1], ...names.slice(k + 1)]);
          show();
          list.children[k - 1].querySelector("button:not(:disabled)")?.focus();
        });
        item.append(swatch, name, earlier);
        return item;
      }));
    };
    list.tabIndex = -1;
    box.append(element("span", "caption", "Order"), list);
    this.fields.set("arrival.order", { input: list, show });
    this.names.set("arrival.order", { text: "Order of the arrivals", input: list });
    return box;
  }

  _sliders(sliders) {
    const group = element("section"), { scenario } = this.page;
    group.append(element("h2", "", "Wind, speeds, limits"), ...sliders.map(({ key, label, unit, step }) => {
      const input = element("input"), output = element("output"), reset = element("button", "plain reset", "↺"), row = element("div", "slider");
      Object.assign(input, { type: "range", step });
      reset.type = "button";
      reset.title = "back to the default";
      reset.setAttribute("aria-label", `${label}: back to the default`);
      input.addEventListener("input", (event) => scenario.set(key, Number(input.value), { held: true, stamp: event.timeStamp }));
      input.addEventListener("change", () => this.page.released());
      reset.addEventListener("click", () => scenario.set(key, undefined));
      const show = () => {
        const { min, max, value } = this.page.welcome.sliders.find((one) => one.key === key) ?? {}, set = scenario.get(key), now = typeof set === "number" ? set : value;
        if (scenario.merge?.key !== key) Object.assign(input, { min: Math.min(min, now), max: Math.max(max, now) }); // the ends stay during a drag
        input.value = String(now);
        output.textContent = `${Number(now.toPrecision(4))} ${unit}`;
        input.setAttribute("aria-valuetext", output.textContent);
        reset.hidden = set === undefined;
      };
      this.fields.set(key, { input, show });
      row.append(this._label(label, "", input, key), output, reset);
      return row;
    }));
    return group;
  }

  /** Mark the inputs that the problems are about. */
  _mark() {
    const keys = new Set(this.page.problems.flatMap((problem) => problem.keys).map((key) => this._nearest(key)));
    this.names.forEach(({ input }, path) => {
      const bound = keys.has(path);
      input.classList.toggle("bound", bound);
      if (input.tagName === "INPUT") input.toggleAttribute("aria-invalid", bound);
      if (bound && input.tagName === "INPUT") input.setAttribute("aria-invalid", "true");
    });
  }

  /** The longest key path with an input that is equal to a key or contains it. */
  _nearest(key) {
    let path = key;
    while (path && !this.names.has(path)) path = path.slice(0, Math.max(0, path.lastIndexOf(".", path.length - 1), path.endsWith("]") ? path.lastIndexOf("[") : 0));
    return path;
  }

  /** Input of a key: of the longest key path that contains it, or of the first entry of a list; undefined without. */
  fieldOf(key) {
    return this.names.get(this._nearest(key)) ?? this.names.get([...this.names.keys()].find((path) => path.startsWith(`${key}[`)));
  }

  /** Name of the empty number field of a key; undefined if it is filled. */
  emptyAt(key) {
    const field = this.names.get(key);
    return field?.input.type === "number" && !field.input.placeholder && field.input.value === "" ? field.text : undefined;
  }

  nameOfKey(key) {
    return this.fieldOf(key)?.text ?? key;
  }

  /** Bring the input of a key into view and into focus. */
  jump(key) {
    const input = this.fieldOf(key)?.input;
    if (!input) return;
    const box = input.closest("details");
    if (box) box.open = true;
    input.scrollIntoView({ block: "center" });
    input.focus();
  }
}
