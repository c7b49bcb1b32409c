/* Cameras of a scene: perspective views, and an orthographic view from above, as on a map. */
"use strict";

const CHASE_KM = 1.1, ROTATE = 0, PAN = 2, TOUCH_ROTATE = 0, TOUCH_PAN = 1; // the last four are the codes of OrbitControls

class Eye {
  constructor(canvas, frame) {
    Object.assign(this, { frame, mode: "overview", lift: 1, width: 1, height: 1, touched: false });
    this.round = new THREE.PerspectiveCamera(38, 1, 0.01, 5000);
    this.flat = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.01, 5000);
    this.camera = this.round;
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 0.495 * Math.PI;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("start", () => { this.touched = true; });
  }

  get chasing() {
    return this.mode === "follow" || this.mode === "behind";
  }

  get aspect() {
    return this.width / this.height;
  }

  resize(width, height) {
    Object.assign(this, { width, height });
    this.round.aspect = this.aspect;
    [this.flat.left, this.flat.right] = [this.flat.bottom * this.aspect, this.flat.top * this.aspect];
    this.camera.updateProjectionMatrix();
  }

  /** Set the view: overview, above, follow (the user orbits the aircraft), behind (the camera turns with the aircraft). */
  look(mode, flyer, time) {
    this.mode = mode;
    this.touched = false;
    this._use(mode === "above" ? this.flat : this.round);
    if (mode === "overview") this._fit(new THREE.Vector3(0.36, 0.68, 0.9));
    else if (mode === "above") this._fitMap();
    else {
      this.follow = null;
      this._chase(flyer, time, CHASE_KM / Math.min(1, this.aspect));
    }
    const size = new THREE.Vector3().subVectors(this.frame.box.max, this.frame.box.min).length();
    this.camera.far = (this.chasing ? 100 : 40) * Math.max(1, size * Math.max(1, this.lift / 3));
    this.camera.updateProjectionMatrix();
    this.controls.update();
  }

  /** The map is panned and zoomed, never rotated: north stays up. */
  _use(camera) {
    const turns = camera === this.round;
    this.camera = this.controls.object = camera;
    this.controls.enableRotate = turns;
    this.controls.mouseButtons.LEFT = turns ? ROTATE : PAN;
    this.controls.touches.ONE = turns ? TOUCH_ROTATE : TOUCH_PAN;
  }

  /** Look straight down without perspective: a ground track coincides with its path. */
  _fitMap() {
    const ends = [Infinity, -Infinity, Infinity, -Infinity];
    for (const [x, , z] of this.frame.points) {
      [ends[0], ends[1]] = [Math.min(ends[0], x), Math.max(ends[1], x)];
      [ends[2], ends[3]] = [Math.min(ends[2], z), Math.max(ends[3], z)];
    }
    const wide = Math.max(ends[1] - ends[0], 0.2), tall = Math.max(ends[3] - ends[2], 0.2);
    const half = 0.56 * Math.max(tall, wide / this.aspect), up = 10 + this.lift * this.frame.box.max.y;
    Object.assign(this.flat, { top: half, bottom: -half, left: -half * this.aspect, right: half * this.aspect, zoom: 1 });
    this.controls.target.set(0.5 * (ends[0] + ends[1]), 0, 0.5 * (ends[2] + ends[3]));
    // slightly south of the vertical, so that north is up
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(0, up, 1e-6 * up));
  }

  /** Look from a side such that the tracks and their ground tracks just fill the picture. */
  _fit(from) {
    const axis = from.clone().normalize(), right = new THREE.Vector3(0, 1, 0).cross(axis).normalize(), up = axis.clone().cross(right);
    const tall = 0.9 * Math.tan((this.round.fov * Math.PI) / 360), wide = tall * this.aspect, { box } = this.frame;
    const target = new THREE.Vector3().addVectors(box.min, box.max).multiplyScalar(0.5);
    target.y *= this.lift;
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
      target.addScaledVector(right, 0.5 * (ends[0] + ends[1]) * away).addScaledVector(up, 0.5 * (ends[2] + ends[3]) * away);
    }
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(axis, away);
  }

  /** Camera behind and slightly above an aircraft, with the horizon in the picture. */
  _chase(flyer, time, away) {
    if (!Number.isFinite(flyer.shownPlace.x)) return;
    this.controls.target.copy(flyer.shownPlace);
    this.camera.position.copy(flyer.shownPlace).addScaledVector(flyer.heading(time), -0.975 * away);
    this.camera.position.y += 0.22 * away;
    this.follow = flyer.shownPlace.clone();
  }

  /** Move with the focused aircraft, in the views that follow. */
  track(flyer, time) {
    if (!this.chasing) return;
    if (!this.follow || this.followed !== flyer || this.mode === "behind") {
      this._chase(flyer, time, this.followed === flyer ? this.camera.position.distanceTo(this.controls.target) : CHASE_KM);
    } else {
      const moved = new THREE.Vector3().subVectors(flyer.shownPlace, this.follow);
      this.camera.position.add(moved);
      this.controls.target.add(moved);
      this.follow.copy(flyer.shownPlace);
    }
    this.followed = flyer;
    this.camera.lookAt(this.controls.target);
  }

  /** Copy the view of another camera. */
  copy(other) {
    this.mode = other.mode;
    this.touched = other.touched;
    this._use(other.camera === other.flat ? this.flat : this.round);
    if (this.chasing) {
      const offset = new THREE.Vector3().subVectors(other.camera.position, other.controls.target);
      this.camera.position.copy(this.controls.target).add(offset);
    } else {
      this.camera.position.copy(other.camera.position);
      this.controls.target.copy(other.controls.target);
    }
    if (this.camera === this.flat) for (const key of ["top", "bottom", "left", "right", "zoom"]) this.flat[key] = other.flat[key];
    this.camera.updateProjectionMatrix();
    this.camera.lookAt(this.controls.target);
  }

  /** Kilometres per pixel at a position. */
  kmPerPixel(place) {
    if (this.camera === this.flat) return (this.flat.top - this.flat.bottom) / this.flat.zoom / this.height;
    return (2 * Math.tan((this.round.fov * Math.PI) / 360) * this.camera.position.distanceTo(place)) / this.height;
  }

  /** Pixel coordinates from the upper left corner, and whether the position is in the picture. */
  pixelsOf(place) {
    const seen = place.clone().project(this.camera);
    return { x: (0.5 + seen.x / 2) * this.width, y: (0.5 - seen.y / 2) * this.height, seen: seen.z < 1 && Math.abs(seen.x) < 1.05 && Math.abs(seen.y) < 1.05 };
  }

  /** Direction of north in the picture, clockwise from up, rad. */
  northward() {
    const away = 0.01 * this.camera.position.distanceTo(this.controls.target);
    const [here, there] = [0, -away].map((z) => this.controls.target.clone().add(new THREE.Vector3(0, 0, z)).project(this.camera));
    return Math.atan2((there.x - here.x) * this.aspect, there.y - here.y);
  }
}
