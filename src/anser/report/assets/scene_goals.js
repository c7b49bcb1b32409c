/* Shapes of goals by form: about two units long, on the ground or around the position; x forward, y up. */
"use strict";

/** Closed body over an outline in the plane (x, z), between two heights; the upper outline may be scaled. */
function hull(outline, low, high, flare) {
  const faces = [], at = ([x, z], y, size) => [x * size, y, z * size];
  outline.forEach((from, k) => {
    const to = outline[(k + 1) % outline.length];
    const [a, b, c, d] = [at(from, low, 1), at(to, low, 1), at(to, high, flare), at(from, high, flare)];
    faces.push(...a, ...b, ...c, ...a, ...c, ...d, ...d, ...c, 0, high, 0);
  });
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(faces), 3));
  geometry.computeVertexNormals();
  return geometry;
}

const box = (x0, x1, half, low, high) => hull([[x0, -half], [x1, -half], [x1, half], [x0, half]], low, high, 1);
const moved = (geometry, x, y, z) => geometry.translate(x, y, z);
const puff = (radius, x, y, z) => moved(new THREE.OctahedronGeometry(radius, 3), x, y, z);

const GOAL_SHAPES = {
  ship: () => [hull([[-0.9, -0.26], [0.45, -0.26], [0.95, 0], [0.45, 0.26], [-0.9, 0.26]], 0, 0.32, 1.12), box(-0.7, -0.15, 0.2, 0.32, 0.75), box(-0.5, -0.32, 0.09, 0.75, 1.05)],
  buoy: () => [moved(new THREE.CylinderGeometry(0.5, 0.42, 0.3, 20), 0, 0.15, 0), moved(new THREE.ConeGeometry(0.32, 0.9, 20), 0, 0.75, 0), puff(0.13, 0, 1.25, 0)],
  drifting: () => [puff(0.55, 0, 0.05, 0), puff(0.42, 0.55, -0.08, 0.1), puff(0.4, -0.55, -0.1, -0.05), puff(0.36, 0.1, 0.05, 0.5), puff(0.36, -0.1, 0.05, -0.5)],
  flying: () => [hull([[0.9, 0], [-0.8, 0.7], [-0.45, 0], [-0.8, -0.7]], -0.06, 0.06, 1)],
  goal: () => [new THREE.OctahedronGeometry(0.45, 0)],
};

/** Mark of a goal by its form (see `anser.report.flight_data.goal_forms`). */
function goalMark(form, color) {
  const mark = new THREE.Group();
  const look = { color, side: THREE.DoubleSide, transparent: form === "drifting", opacity: form === "drifting" ? 0.75 : 1 };
  for (const geometry of GOAL_SHAPES[form]()) mark.add(new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(look)));
  return mark;
}

/** Rotation about the vertical that points a mark along the goal's motion, rad; 0, east, for a goal at rest. */
function courseOf(run, k, time) {
  const from = Math.max(0, Math.min(time, run.end - 1)), moved = ["north", "east"].map((axis) => run.at(`goal_${axis}_m`, k, from + 1) - run.at(`goal_${axis}_m`, k, from));
  return Math.hypot(...moved) > 0.1 ? Math.atan2(moved[0], moved[1]) : 0;
}
