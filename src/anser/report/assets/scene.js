/* The flight in three dimensions: drawn only when something changed. */
"use strict";

class FlightScene {
  constructor(run, state, frame, options) {
    Object.assign(this, { run, state, frame, options });
    this.root = element("div", "scene");
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    this.renderer.setClearColor(SKY);
    this.root.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.01, 5000);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 0.495 * Math.PI;
    this.controls.zoomToCursor = true;
    this.peers = [];
    this.mode = "overview";
    this._light();
    this._fill();
    this._labels();
    this.controls.addEventListener("change", () => {
      this.invalidate();
      if (this.state.leading === this) this.peers.forEach((peer) => peer._copy(this));
    });
    this.root.addEventListener("pointerdown", () => { this.state.leading = this; });
    this.root.addEventListener("wheel", () => { this.state.leading = this; }, { passive: true });
    this.renderer.domElement.addEventListener("pointermove", (event) => this._hover(event));
    this.renderer.domElement.addEventListener("click", (event) => {
      const hit = this._nearest(event);
      if (hit && this.moved < 5) state.setFocus(hit.one.name);
    });
    this.renderer.domElement.addEventListener("pointerdown", (event) => { this.pressed = [event.clientX, event.clientY]; this.moved = 0; });
    for (const what of ["shown", "focus", "time"]) state.on(what, () => this.update());
    new ResizeObserver(() => this._resize()).observe(this.root);
  }

  _light() {
    this.scene.add(new THREE.AmbientLight(0xffffff, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(-2, 5, 3);
    this.scene.add(sun);
  }

  _fill() {
    this.lifted = new THREE.Group();
    this.scene.add(this.lifted);
    const { grid, spacing } = groundGrid(this.frame.box);
    this.spacing = spacing;
    this.lifted.add(grid);
    this.flyers = this.run.aircraft.map((_, k) => new Flyer(this.run, k, this.frame.middle, this.lifted, this.scene, spacing / 8));
    this.keepOuts = this.run.keepOuts.map((one) => {
      const edges = keepOutEdges(one);
      this.lifted.add(edges);
      return { one, edges };
    });
  }

  _labels() {
    this.labels = this.flyers.map((flyer) => {
      const label = element("span", "label", flyer.one.name);
      label.style.color = flyer.one.color;
      this.root.append(label);
      return label;
    });
    this.compass = element("span", "compass");
    this.compass.append(element("b", "", "N"));
    this.legend = element("p", "scene-legend");
    this.root.append(this.compass, this.legend);
  }

  _resize() {
    const width = this.root.clientWidth, height = this.root.clientHeight;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio || 1));
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.placed) this.look("overview");
    else this.update();
  }

  setLift(lift) {
    this.lift = lift;
    this.lifted.scale.y = lift;
    if (this.mode === "overview" || this.mode === "above") this.look(this.mode);
    this.update();
  }

  get focus() {
    return this.flyers[this.run.indexOf(this.state.focus)] || this.flyers[0];
  }

  /** Take up a view: overview, above, follow (the user turns around the aircraft), behind (the view turns with it). */
  look(mode) {
    this.mode = mode;
    this.placed = true;
    const box = this.frame.box, size = new THREE.Vector3().subVectors(box.max, box.min);
    const middle = new THREE.Vector3().addVectors(box.min, box.max).multiplyScalar(0.5);
    middle.y *= this.lift;
    const aspect = Math.min(1, this.camera.aspect);
    if (mode === "overview") {
      this._fit(new THREE.Vector3(0.36, 0.68, 0.9), middle);
    } else if (mode === "above") {
      this._fit(new THREE.Vector3(0, 1, 1e-4), middle);
    } else {
      this.follow = null;
      this._chase(1.1 / aspect);
    }
    this.camera.far = 40 * Math.max(1, size.length());
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.update();
  }

  /** Look from a side so that all tracks, and the ground below them, just fill the picture. */
  _fit(from, middle) {
    const axis = from.clone().normalize(), right = new THREE.Vector3(0, 1, 0).cross(axis).normalize(), up = axis.clone().cross(right);
    const tall = 0.9 * Math.tan((this.camera.fov * Math.PI) / 360), wide = tall * this.camera.aspect, target = middle.clone();
    let away = 0.5;
    for (let turn = 0; turn < 6; turn++) {
      const ends = [Infinity, -Infinity, Infinity, -Infinity];
      away = 0.5;
      for (const point of this.frame.points) {
        const at = new THREE.Vector3(point[0], point[1] * this.lift, point[2]).sub(target), depth = at.dot(axis);
        away = Math.max(away, Math.abs(at.dot(right)) / wide + depth, Math.abs(at.dot(up)) / tall + depth);
      }
      for (const point of this.frame.points) {
        const at = new THREE.Vector3(point[0], point[1] * this.lift, point[2]).sub(target), depth = away - at.dot(axis);
        const x = at.dot(right) / depth, y = at.dot(up) / depth;
        ends[0] = Math.min(ends[0], x);
        ends[1] = Math.max(ends[1], x);
        ends[2] = Math.min(ends[2], y);
        ends[3] = Math.max(ends[3], y);
      }
      target.addScaledVector(right, (0.5 * (ends[0] + ends[1])) * away).addScaledVector(up, 0.5 * (ends[2] + ends[3]) * away);
    }
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(axis, away);
  }

  /** Direction of flight over the plane in the scene. */
  _heading(flyer) {
    const before = new THREE.Vector3(), after = new THREE.Vector3(), time = this.state.time;
    placeAt(flyer.run, "", flyer.k, Math.max(0, time - 0.5), flyer.middle, before);
    placeAt(flyer.run, "", flyer.k, Math.min(flyer.run.end, Math.max(0, time - 0.5) + 1), flyer.middle, after);
    after.sub(before).setY(0);
    return after.lengthSq() > 0 ? after.normalize() : new THREE.Vector3(0, 0, -1);
  }

  _chase(away) {
    const flyer = this.focus;
    if (!Number.isFinite(flyer.shownPlace.x)) return;
    const heading = this._heading(flyer);
    this.controls.target.copy(flyer.shownPlace);
    this.camera.position.copy(flyer.shownPlace).addScaledVector(heading, -0.93 * away);
    this.camera.position.y += 0.36 * away;
    this.follow = flyer.shownPlace.clone();
  }

  _track() {
    if (this.mode !== "follow" && this.mode !== "behind") return;
    const flyer = this.focus;
    if (!this.follow || this.followed !== flyer || this.mode === "behind") {
      this._chase(this.followed === flyer ? this.camera.position.distanceTo(this.controls.target) : 1.1);
    } else {
      const moved = new THREE.Vector3().subVectors(flyer.shownPlace, this.follow);
      this.camera.position.add(moved);
      this.controls.target.add(moved);
      this.follow.copy(flyer.shownPlace);
    }
    this.followed = flyer;
    this.camera.lookAt(this.controls.target);
  }

  _copy(other) {
    this.mode = other.mode;
    if (this.mode === "overview" || this.mode === "above") {
      this.camera.position.copy(other.camera.position);
      this.controls.target.copy(other.controls.target);
    } else {
      const offset = new THREE.Vector3().subVectors(other.camera.position, other.controls.target);
      this.camera.position.copy(this.controls.target).add(offset);
    }
    this.camera.lookAt(this.controls.target);
    this.invalidate();
  }

  update() {
    const { state } = this, few = this.flyers.length <= FEW;
    this.focusName = state.focus;
    for (const flyer of this.flyers) {
      flyer.show(!state.hidden.has(flyer.one.name), flyer.one.name === state.focus, { ...this.options, few });
      flyer.update(state.time, this.lift);
    }
    for (const { one, edges } of this.keepOuts) {
      const course = (one.course_deg * Math.PI) / 180, gone = one.speed_m_s * state.time, [north, east] = this.frame.middle;
      edges.position.set((one.east_m + gone * Math.sin(course) - east) / 1000, 0, -(one.north_m + gone * Math.cos(course) - north) / 1000);
    }
    this._track();
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
    const height = this.root.clientHeight, half = 2 * Math.tan((this.camera.fov * Math.PI) / 360), eye = this.camera.position;
    if (!height) return;
    const near = this.mode === "follow" || this.mode === "behind" ? 2.2 : 1;
    const sizeAt = (place, pixels) => (near * pixels * half * eye.distanceTo(place)) / height;
    for (const flyer of this.flyers) flyer.turn(this.state.time, sizeAt);
    this.renderer.render(this.scene, this.camera);
    const [here, there] = [0, -0.01].map((z) => this.controls.target.clone().add(new THREE.Vector3(0, 0, z * eye.distanceTo(this.controls.target))).project(this.camera));
    const turned = Math.atan2((there.x - here.x) * this.camera.aspect, there.y - here.y);
    this.compass.style.transform = `rotate(${turned.toFixed(3)}rad)`;
    const few = this.flyers.length <= 6;
    this.flyers.forEach((flyer, k) => {
      const wanted = flyer.symbol.visible && (few || flyer.one.name === this.state.focus || flyer === this.hovered);
      this._place(this.labels[k], flyer.shownPlace, wanted, -16);
    });
    this.legend.textContent = `grid ${this.spacing.toLocaleString("en-US")} km, heights ×${this.lift}`;
  }

  _place(label, place, wanted, below) {
    const seen = place.clone().project(this.camera);
    const shown = wanted && seen.z < 1 && Math.abs(seen.x) < 1.05 && Math.abs(seen.y) < 1.05;
    label.hidden = !shown;
    if (!shown) return;
    const x = (0.5 + seen.x / 2) * this.root.clientWidth, y = (0.5 - seen.y / 2) * this.root.clientHeight + below;
    label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
  }

  _nearest(event) {
    const bounds = this.root.getBoundingClientRect();
    let best = null, least = 22;
    for (const flyer of this.flyers) {
      if (!flyer.symbol.visible) continue;
      const seen = flyer.shownPlace.clone().project(this.camera);
      const away = Math.hypot((0.5 + seen.x / 2) * bounds.width + bounds.left - event.clientX, (0.5 - seen.y / 2) * bounds.height + bounds.top - event.clientY);
      if (seen.z < 1 && away < least) [best, least] = [flyer, away];
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
