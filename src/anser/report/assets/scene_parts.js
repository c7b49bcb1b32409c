/* Parts of a scene. Axes: x east, y up, z south; km from a common centre. Heights are scaled by `lift`. */
"use strict";

const TRACK_OFF = 0.0006; // km; greatest deviation of a drawn track from the record

/** Position of an aircraft, goal or rendezvous in scene coordinates, without vertical exaggeration. */
function placeAt(run, prefix, k, time, middle, into) {
  const at = (axis) => run.at(`${prefix}${axis}_m`, k, time);
  return into.set((at("east") - middle[1]) / 1000, at("altitude") / 1000, -(at("north") - middle[0]) / 1000);
}

/** Points that suffice to draw a line within `TRACK_OFF` (Douglas and Peucker 1973); x, y, z one after the other. */
function enough(points) {
  const count = points.length / 3, kept = new Uint8Array(count), open = [[0, count - 1]];
  if (count) kept[0] = kept[count - 1] = 1;
  while (open.length) {
    const [first, last] = open.pop(), from = points.slice(3 * first, 3 * first + 3);
    const along = [0, 1, 2].map((a) => points[3 * last + a] - from[a]), square = along[0] ** 2 + along[1] ** 2 + along[2] ** 2;
    let worst = TRACK_OFF ** 2, at = 0;
    for (let j = first + 1; j < last; j++) {
      const x = points[3 * j] - from[0], y = points[3 * j + 1] - from[1], z = points[3 * j + 2] - from[2];
      const part = square > 0 ? Math.min(1, Math.max(0, (x * along[0] + y * along[1] + z * along[2]) / square)) : 0;
      const off = (x - part * along[0]) ** 2 + (y - part * along[1]) ** 2 + (z - part * along[2]) ** 2;
      if (off > worst) [worst, at] = [off, j];
    }
    if (!at) continue;
    kept[at] = 1;
    open.push([first, at], [at, last]);
  }
  return kept;
}

/** Points that suffice to draw a track up to a time, without missing records, and the index of each record. */
function trackOf(run, prefix, k, middle, until = Infinity) {
  const [north, east, up] = ["north", "east", "altitude"].map((axis) => run.values(`${prefix}${axis}_m`)[k]);
  const all = [], records = [], end = run.locate(until)[0];
  for (let j = 0; j <= end; j++) {
    if (!Number.isFinite(north[j] + east[j] + up[j])) continue;
    all.push((east[j] - middle[1]) / 1000, up[j] / 1000, -(north[j] - middle[0]) / 1000);
    records.push(j);
  }
  const kept = enough(all);
  return { points: all.filter((_, i) => kept[Math.floor(i / 3)]), records: records.filter((_, i) => kept[i]) };
}

/** Bounding box of the tracks of all runs, km, and the centre (north, east; m) of the scenes. */
function frameOf(runs) {
  const ends = [Infinity, -Infinity, Infinity, -Infinity, 0, -Infinity];
  for (const run of runs) {
    ["north", "east", "altitude"].forEach((axis, a) => {
      for (const prefix of ["", "rendezvous_"]) {
        for (const row of run.values(`${prefix}${axis}_m`)) {
          for (const value of row) {
            if (value < ends[2 * a]) ends[2 * a] = value;
            if (value > ends[2 * a + 1]) ends[2 * a + 1] = value;
          }
        }
      }
    });
  }
  const [n0, n1, e0, e1, h0, h1] = ends.map((value) => (Number.isFinite(value) ? value : 0));
  const middle = [(n0 + n1) / 2, (e0 + e1) / 2];
  const box = new THREE.Box3(
    new THREE.Vector3((e0 - middle[1]) / 1000, h0 / 1000, -(n1 - middle[0]) / 1000),
    new THREE.Vector3((e1 - middle[1]) / 1000, h1 / 1000, -(n0 - middle[0]) / 1000)
  );
  return { middle, box, points: pointsOf(runs, middle) };
}

/** About a hundred points of every track, and their projections on the ground. */
function pointsOf(runs, middle) {
  const points = [];
  for (const run of runs) {
    run.aircraft.forEach((_, k) => {
      const track = trackOf(run, "", k, middle).points;
      for (let j = 0; j < track.length; j += 3 * Math.max(1, Math.floor(track.length / 300))) {
        points.push([track[j], track[j + 1], track[j + 2]], [track[j], 0, track[j + 2]]);
      }
    });
  }
  return points;
}

/** Vertical exaggeration that makes heights visible in a wide scene. */
function liftOf(box) {
  const wide = Math.max(box.max.x - box.min.x, box.max.z - box.min.z), tall = Math.max(box.max.y - box.min.y, 0.05);
  return [1, 2, 3, 5].find((lift) => lift * tall >= 0.16 * wide) || 5;
}

/** Line with a width in pixels. */
function fatLine(points, color, width, options = {}) {
  const geometry = new THREE.LineGeometry();
  geometry.setPositions(points);
  const line = new THREE.Line2(geometry, new THREE.LineMaterial({ color, linewidth: width, transparent: true, ...options }));
  if (options.dashed) line.computeLineDistances();
  line.frustumCulled = false;
  return line;
}

/** A second line over the same points, of which only a part is drawn. */
function partOf(line, color, width) {
  const geometry = new THREE.LineGeometry();
  for (const name of ["instanceStart", "instanceEnd"]) geometry.setAttribute(name, line.geometry.attributes[name]);
  geometry.instanceCount = 0;
  const part = new THREE.Line2(geometry, new THREE.LineMaterial({ color, linewidth: width, transparent: true }));
  part.renderOrder = 2; // above the plan
  part.frustumCulled = false;
  return part;
}

function thinLine(points, color, opacity = 1) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
  return new THREE.Line(geometry, new THREE.LineBasicMaterial({ color, transparent: opacity < 1, opacity }));
}

/** Symbol of an attitude, independent of the type of aircraft: a dart, x forward, y up, z right, two units long. */
function dart(color) {
  const nose = [1, 0, 0], left = [-0.85, 0, -0.72], right = [-0.85, 0, 0.72], notch = [-0.5, 0.02, 0];
  const fin = [[-0.05, 0.02, 0], [-0.5, 0.02, 0], [-0.9, 0.5, 0]];
  const faces = [nose, notch, left, nose, right, notch, ...fin].flat();
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(faces), 3));
  geometry.computeVertexNormals();
  const group = new THREE.Group();
  const body = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color, side: THREE.DoubleSide }));
  const rim = thinLine([nose, right, notch, left, nose].flat(), Theme.ink("ink"));
  group.add(body, rim);
  group.matrixAutoUpdate = false;
  return group;
}

/** Ground grid with a round spacing in km; `wide` extends to the horizon, for views along the ground. */
function groundGrid(box) {
  const reach = Math.max(box.max.x - box.min.x, box.max.z - box.min.z, 0.1);
  const spacing = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find((s) => reach / s <= 14) || 200;
  const ends = (more) => ["x", "z"].map((axis) => [Math.floor(box.min[axis] / spacing) - more, Math.ceil(box.max[axis] / spacing) + more].map((n) => n * spacing));
  const lines = (into, [[x0, x1], [z0, z1]], step, ink) => {
    const points = [], geometry = new THREE.BufferGeometry(), marks = (from, to, by) => Array.from({ length: Math.round((to - from) / by) + 1 }, (_, k) => from + k * by);
    // in pieces: a line that starts far behind the camera is drawn badly
    for (const x of marks(x0, x1, step)) for (const z of marks(z0, z1 - spacing, spacing)) points.push(x, 0, z, x, 0, z + spacing);
    for (const z of marks(z0, z1, step)) for (const x of marks(x0, x1 - spacing, spacing)) points.push(x, 0, z, x + spacing, 0, z);
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    const made = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: Theme.ink(ink) }));
    made.renderOrder = -1;
    into.add(made);
  };
  const floor = (into, [[x0, x1], [z0, z1]]) => {
    const corners = [x0, 0, z0, x0, 0, z1, x1, 0, z1, x0, 0, z0, x1, 0, z1, x1, 0, z0], geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(corners), 3));
    const made = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: Theme.ink("ground"), side: THREE.DoubleSide, depthWrite: false }));
    made.renderOrder = -2;
    into.add(made);
  };
  const near = ends(0), far = ends(Math.ceil((3 * reach) / spacing)), [[x0, x1], [z0, z1]] = near;
  const plate = new THREE.Group(), wide = new THREE.Group();
  floor(plate, near);
  lines(plate, near, spacing / 5, "ground-fine");
  lines(plate, near, spacing, "ground-line");
  plate.add(thinLine([x0, 0, z0, x1, 0, z0, x1, 0, z1, x0, 0, z1, x0, 0, z0], Theme.ink("ground-edge")));
  floor(wide, ends(Math.ceil((30 * reach) / spacing)));
  lines(wide, near, spacing / 5, "ground-fine");
  lines(wide, far, spacing, "ground-line");
  return { plate, wide, spacing, reach };
}

/** Edges of a keep-out, an upright cylinder. */
function keepOutEdges(one) {
  const group = new THREE.Group(), radius = one.radius_m / 1000;
  const top = Math.min(one.top_m, one.bottom_m + 3 * one.radius_m) / 1000;
  const circle = (height) => Array.from({ length: 65 }, (_, k) => [radius * Math.cos((k * Math.PI) / 32), height, radius * Math.sin((k * Math.PI) / 32)]).flat();
  for (let k = 0; k <= 4; k++) group.add(thinLine(circle(one.bottom_m / 1000 + (k / 4) * (top - one.bottom_m / 1000)), Theme.ink("limit"), 0.6));
  return group;
}

/** An aircraft with its tracks, its goal and its stand-off point; the static parts are scaled vertically as one group. */
class Flyer {
  constructor(run, k, middle, lifted, scene, dash) {
    const one = run.aircraft[k], until = one.arrival_s ?? one.planned_arrival_s ?? Infinity;
    Object.assign(this, { run, k, one, middle });
    const { points, records } = trackOf(run, "", k, middle);
    Object.assign(this, { points, records });
    this.parts = [];
    this.track = fatLine(points.length >= 6 ? points : [0, 0, 0, 0, 0, 0], one.color, 1.2, { opacity: 0.3, depthWrite: false });
    this.trail = partOf(this.track, one.color, 2.6);
    this.head = fatLine([0, 0, 0, 0, 0, 0], one.color, 2.6);
    this.head.renderOrder = 2;
    this.shadow = thinLine(points.map((value, i) => (i % 3 === 1 ? 0 : value)), Theme.ink("quiet"), 0.35);
    const plan = trackOf(run, "reference_", k, middle, until).points;
    if (plan.length >= 6) {
      this.plan = fatLine(plan, Theme.ink("ink"), 1, { dashed: true, dashSize: 0.6 * dash, gapSize: 0.4 * dash, opacity: 0.7, depthWrite: false });
      this.parts.push(this.plan);
    }
    const goal = trackOf(run, "goal_", k, middle, until).points;
    if (goal.length >= 6) this.parts.push(thinLine(goal, Theme.ink("goal"), 0.5));
    this.parts.push(this.track, this.trail, this.head, this.shadow);
    this.pole = thinLine([0, 0, 0, 0, 1, 0], Theme.ink("goal"), 0.5);
    this.drop = thinLine([0, 0, 0, 0, 1, 0], one.color, 0.55);
    this.parts.push(this.pole, this.drop);
    lifted.add(...this.parts);
    this.symbol = dart(one.color);
    this.goal = goalMark(one.form, Theme.ink("goal"));
    this.meeting = new THREE.Mesh(new THREE.OctahedronGeometry(1, 0), new THREE.MeshLambertMaterial({ color: one.color }));
    this.renewals = this._renewals();
    lifted.add(this.renewals);
    scene.add(this.symbol, this.goal, this.meeting);
    this.place = new THREE.Vector3();
    this.shownPlace = new THREE.Vector3();
    this.goalPlace = new THREE.Vector3();
    this.meetingPlace = new THREE.Vector3();
  }

  /** Points on the track at changes of the plan: large for a new plan or a failed replanning. */
  _renewals() {
    const found = new THREE.Group(), at = new THREE.Vector3();
    renewalInks().forEach((color, what) => {
      const points = [], geometry = new THREE.BufferGeometry();
      for (const [time, how] of this.run.events[this.k].renewals) {
        if (how !== what) continue;
        placeAt(this.run, "", this.k, time, this.middle, at);
        if (Number.isFinite(at.x + at.y + at.z)) points.push(at.x, at.y, at.z);
      }
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
      // a dark rim separates a large symbol from a track of the same colour
      for (const [ink, size] of what >= 2 ? [[Theme.ink("ink"), 10], [color, 6]] : [[color, 2]]) {
        const look = { color: ink, size, sizeAttenuation: false, transparent: true, depthTest: false };
        const dots = new THREE.Points(geometry, new THREE.PointsMaterial(look));
        dots.renderOrder = 3;
        dots.frustumCulled = false;
        found.add(dots);
      }
    });
    return found;
  }

  show(shown, focused, options) {
    [...this.parts, this.symbol, this.goal, this.meeting].forEach((part) => { part.visible = shown; });
    if (this.plan) this.plan.visible = shown && options.plans && (focused || options.few);
    this.shadow.visible = shown && (focused || options.few);
    this.renewals.visible = shown && focused && options.plans;
    this.trail.material.linewidth = this.head.material.linewidth = focused ? 3.6 : 2.2;
    this.track.material.opacity = focused ? 0.6 : 0.25;
  }

  /** Move the parts to their positions at a time. Returns whether the aircraft has a position at that time. */
  update(time, lift) {
    const { run, k } = this, record = run.locate(time)[0];
    placeAt(run, "", k, time, this.middle, this.place);
    const here = Number.isFinite(this.place.x + this.place.y + this.place.z);
    this.symbol.visible = this.symbol.visible && here;
    let count = 0;
    while (count < this.records.length && this.records[count] <= record) count++;
    this.trail.geometry.instanceCount = Math.max(0, count - 1);
    this.head.visible = this.track.visible && here && count > 0;
    if (this.head.visible) {
      const last = this.points.slice(3 * count - 3, 3 * count);
      this.head.geometry.attributes.instanceStart.data.array.set([...last, this.place.x, this.place.y, this.place.z]);
      this.head.geometry.attributes.instanceStart.data.needsUpdate = true;
    }
    if (here) {
      this.shownPlace.set(this.place.x, this.place.y * lift, this.place.z);
      this._segment(this.drop, this.place, 0);
    }
    this._point(this.goal, placeAt(run, "goal_", k, time, this.middle, this.goalPlace), lift);
    this._point(this.meeting, placeAt(run, "rendezvous_", k, time, this.middle, this.meetingPlace), lift);
    this._segment(this.pole, this.meetingPlace, this.goalPlace.y);
    return here;
  }

  _point(mesh, place, lift) {
    const there = Number.isFinite(place.x + place.y + place.z);
    mesh.visible = mesh.visible && there;
    if (there) mesh.position.set(place.x, place.y * lift, place.z);
  }

  _segment(line, top, bottom) {
    const positions = line.geometry.attributes.position;
    positions.setXYZ(0, top.x, bottom, top.z);
    positions.setXYZ(1, top.x, top.y, top.z);
    positions.needsUpdate = true;
    line.frustumCulled = false;
  }

  /** Direction of flight over the ground, in scene coordinates. */
  heading(time) {
    const before = new THREE.Vector3(), after = new THREE.Vector3(), from = Math.max(0, time - 0.5);
    placeAt(this.run, "", this.k, from, this.middle, before);
    placeAt(this.run, "", this.k, Math.min(this.run.end, from + 1), this.middle, after);
    after.sub(before).setY(0);
    return after.lengthSq() > 0 ? after.normalize() : new THREE.Vector3(0, 0, -1);
  }

  /** Rotate and scale the symbols: body axes from the quaternion (north, east, down to body). */
  turn(time, sizeAt) {
    const q = [0, 1, 2, 3].map((n) => this.run.at(`quaternion_${n}`, this.k, time));
    const norm = Math.hypot(...q);
    if (!(norm > 0.5)) return;
    const [w, x, y, z] = q.map((value) => value / norm);
    // columns of the rotation matrix from body to north, east, down
    const forward = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)];
    const right = [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)];
    const down = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
    const turned = ([n, e, d], sign, size) => new THREE.Vector3(sign * e * size, -sign * d * size, -sign * n * size);
    const size = sizeAt(this.shownPlace, 13);
    this.symbol.matrix.makeBasis(turned(forward, 1, size), turned(down, -1, size), turned(right, 1, size));
    this.symbol.matrix.setPosition(this.shownPlace);
    this.goal.scale.setScalar(sizeAt(this.goal.position, 9));
    this.goal.rotation.y = courseOf(this.run, this.k, time);
    this.meeting.scale.setScalar(sizeAt(this.meeting.position, 5));
  }
}
