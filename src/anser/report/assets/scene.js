/* The flight in three dimensions; drawn only after a change. */
"use strict";

const NAMED = 6; // up to this number, aircraft and goals have their names in the scene

class FlightScene {
  constructor(run, state, frame, options, lift) {
    Object.assign(this, { run, state, frame, options });
    this.root = element("div", "scene");
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    const canvas = this.renderer.domElement;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "The flight in three dimensions");
    this.root.append(canvas);
    this.scene = new THREE.Scene();
    this.eye = new Eye(canvas, frame);
    this.eye.lift = lift;
    this.labels = new Labels(this.root);
    this.peers = [];
    this._fill();
    this._signs();
    this.controls.addEventListener("change", () => {
      this.invalidate();
      if (this.state.leading === this) this.peers.forEach((peer) => peer._copy(this));
    });
    this.root.addEventListener("pointerdown", () => { this.state.leading = this; });
    this.root.addEventListener("wheel", () => { this.state.leading = this; }, { passive: true });
    canvas.addEventListener("pointermove", (event) => this._hover(event));
    canvas.addEventListener("click", (event) => {
      const hit = this._nearest(event);
      if (hit && this.moved < 5) state.setFocus(hit.one.name);
    });
    canvas.addEventListener("pointerdown", (event) => { this.pressed = [event.clientX, event.clientY]; this.moved = 0; });
    for (const what of ["shown", "focus", "time"]) state.on(what, () => this.update());
    new ResizeObserver(() => this._resize()).observe(this.root);
    Theme.on(() => this._repaint());
  }

  get camera() {
    return this.eye.camera;
  }

  get controls() {
    return this.eye.controls;
  }

  get focus() {
    return this.flyers[this.run.indexOf(this.state.focus)] || this.flyers[0];
  }

  _fill() {
    this.renderer.setClearColor(Theme.ink("paper"));
    if (!this.lights) { // the renderer keeps values of every light that was ever in the scene
      const sun = new THREE.DirectionalLight(0xffffff, 1.6);
      sun.position.set(-2, 5, 3);
      this.lights = [new THREE.AmbientLight(0xffffff, 2.2), sun];
    }
    this.lifted = new THREE.Group();
    this.scene.add(...this.lights, this.lifted);
    this.lifted.scale.y = this.eye.lift;
    this.ground = groundGrid(this.frame.box);
    this.lifted.add(this.ground.plate, this.ground.wide);
    this.fog = new THREE.Fog(Theme.ink("paper"), 0.3 * this.ground.reach, 3 * this.ground.reach);
    this.flyers = this.run.aircraft.map((_, k) => new Flyer(this.run, k, this.frame.middle, this.lifted, this.scene, this.ground.spacing / 8));
    this.keepOuts = this.run.keepOuts.map((one) => {
      const edges = keepOutEdges(one);
      this.lifted.add(edges);
      return { one, edges };
    });
  }

  /** Show another run in place of the present run; a camera that was moved stays where it is. */
  replace(run, frame, lift) {
    Object.assign(this, { run, frame });
    Object.assign(this.eye, { frame, lift });
    this._repaint();
  }

  /** Redraw in the current colours, in the current size of the element. */
  _repaint() {
    this.scene.traverse((part) => { part.geometry?.dispose(); part.material?.dispose(); });
    this.scene.clear();
    this.hovered = null;
    this.eye.follow = null;
    this._fill();
    this._resize();
  }

  _signs() {
    this.compass = element("span", "compass");
    this.compass.append(element("b", "", "N"));
    this.legend = element("p", "scene-legend");
    this.bar = element("span", "scale-bar");
    this.root.append(this.compass, this.legend, this.bar);
  }

  _resize() {
    const width = this.root.clientWidth, height = this.root.clientHeight;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Theme.printing ? 2 : Math.min(2, devicePixelRatio || 1));
    this.renderer.setSize(width, height);
    this.eye.resize(width, height);
    if (!this.placed || (!this.eye.touched && !this.eye.chasing)) this.look(this.eye.mode);
    else this.update();
    this.draw(); // draw immediately: a resized canvas is empty, and the next frame comes after the page is painted
  }

  setLift(lift) {
    this.eye.lift = this.lifted.scale.y = lift;
    if (!this.eye.chasing) this.look(this.eye.mode);
    this.update();
  }

  look(mode) {
    this.placed = true;
    this.eye.look(mode, this.focus, this.state.time);
    this.update();
  }

  _copy(other) {
    this.eye.copy(other.eye);
    this.invalidate();
  }

  update() {
    const { state, eye } = this, few = this.flyers.length <= FEW;
    for (const flyer of this.flyers) {
      flyer.show(!state.hidden.has(flyer.one.name), flyer.one.name === state.focus, { ...this.options, few });
      flyer.update(state.time, eye.lift);
    }
    for (const { one, edges } of this.keepOuts) {
      const course = (one.course_deg * Math.PI) / 180, from = one.from_s ?? 0, gone = one.speed_m_s * (state.time - from), [north, east] = this.frame.middle;
      edges.position.set((one.east_m + gone * Math.sin(course) - east) / 1000, 0, -(one.north_m + gone * Math.cos(course) - north) / 1000);
      edges.visible = state.time >= from;
    }
    eye.track(this.focus, state.time);
    this.ground.plate.visible = !eye.chasing;
    this.ground.wide.visible = eye.chasing;
    this.scene.fog = eye.chasing ? this.fog : null;
    this.invalidate();
  }

  invalidate() {
    if (this.due) return;
    this.due = requestAnimationFrame(() => {
      this.due = 0;
      this.draw();
    });
  }

  draw() {
    if (!this.root.clientHeight) return;
    const { eye } = this, near = eye.chasing ? 2.2 : 1;
    const sizeAt = (place, pixels) => near * pixels * eye.kmPerPixel(place);
    for (const flyer of this.flyers) flyer.turn(this.state.time, sizeAt);
    this.renderer.render(this.scene, this.camera);
    this.labels.place(this._named(), eye);
    this.compass.style.transform = `rotate(${eye.northward().toFixed(3)}rad)`;
    this.legend.textContent = `grid ${this.ground.spacing.toLocaleString("en-US")} km, heights ×${eye.lift}`;
    this.bar.hidden = eye.mode !== "above";
    if (this.bar.hidden) return;
    const perKm = 1 / eye.kmPerPixel(eye.controls.target), most = Math.min(160, 0.3 * eye.width);
    const long = [100, 50, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1, 0.05, 0.02].find((km) => km * perKm <= most) || 0.01;
    this.bar.style.width = `${(long * perKm).toFixed(1)}px`;
    this.bar.textContent = long >= 1 ? `${long} km` : `${Math.round(1000 * long)} m`;
  }

  /** Names to show: in a large fleet, those of the aircraft in focus and under the mouse; likewise for goals. */
  _named() {
    const flying = this.flyers.filter((flyer) => flyer.symbol.visible), chosen = (flyer) => flyer === this.hovered || flyer.one.name === this.state.focus;
    const goals = new Map();
    for (const flyer of this.flyers) {
      const name = this.run.goalAt(flyer.k, this.state.time), before = goals.get(name);
      if (flyer.goal.visible && (!before || chosen(flyer))) goals.set(name, flyer);
    }
    const few = flying.length <= NAMED, fewGoals = goals.size <= NAMED;
    return [
      ...flying.filter((flyer) => few || chosen(flyer)).map((flyer) => ({ name: flyer.one.name, place: flyer.shownPlace, color: flyer.one.color, side: -1 })),
      ...[...goals].filter(([, flyer]) => fewGoals || chosen(flyer)).map(([name, flyer]) => ({ name, place: flyer.goal.position, color: "", side: 1 })),
    ];
  }

  _nearest(event) {
    const bounds = this.root.getBoundingClientRect();
    let best = null, least = 22;
    for (const flyer of this.flyers) {
      if (!flyer.symbol.visible) continue;
      const { x, y, seen } = this.eye.pixelsOf(flyer.shownPlace);
      const away = Math.hypot(x + bounds.left - event.clientX, y + bounds.top - event.clientY);
      if (seen && away < least) [best, least] = [flyer, away];
    }
    return best;
  }

  _hover(event) {
    if (this.pressed) this.moved = Math.max(this.moved || 0, Math.hypot(event.clientX - this.pressed[0], event.clientY - this.pressed[1]));
    const hit = event.buttons ? null : this._nearest(event);
    this.renderer.domElement.style.cursor = hit ? "pointer" : "";
    if (hit === this.hovered) return;
    this.hovered = hit;
    this.invalidate();
  }
}
