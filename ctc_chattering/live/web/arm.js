// Arms of capsules on a canvas, with the desired poses: export.html.
//
//   const draw = ctcArm(canvas, data, value);
//
// data = {reach, floor, begin, end, runs: [{place, bodies}, ...]} comes from bag_page.py.
// value(r, signal, joint, t) is a signal of run r at a time. draw(t) draws a time [s].
'use strict';
const ctcArm = (canvas, data, value) => {
  // --- kinematics, by (FK1) of kinematics.py
  function pose({ origin, kind, axis: [x, y, z] }, q) {
    const matrix = new DOMMatrix(origin);
    return kind === 'prismatic' ? matrix.translate(q * x, q * y, q * z)
      : matrix.rotateAxisAngle(x, y, z, q * 180 / Math.PI);
  }
  function capsules(r, signal, t) {
    const run = data.runs[r], poses = [], found = [];
    for (const body of run.bodies) {
      let inRoot = pose(body, body.joint < 0 ? 0 : value(r, signal, body.joint, t));
      if (body.parent >= 0) inRoot = poses[body.parent].multiply(inRoot);
      poses.push(inRoot);
      const placed = (...point) => {
        const { x, y, z } = inRoot.transformPoint(new DOMPoint(...point));
        return [x + run.place[0], y + run.place[1], z + run.place[2]];
      };
      for (const [x, y, z, radius] of body.capsules)
        found.push([placed(0, 0, 0), placed(x, y, z), radius]);
    }
    return found;
  }

  // --- the view
  const view = { azimuth: -1.35, elevation: 0.25, distance: 2 * data.reach,
    target: [0, 0, 0] };
  let now = data.begin;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  // Right, up and backward, as page.py has them.
  function axes() {
    const [ca, sa] = [Math.cos(view.azimuth), Math.sin(view.azimuth)];
    const [ce, se] = [Math.cos(view.elevation), Math.sin(view.elevation)];
    return [[-sa, ca, 0], [-ca * se, -sa * se, ce], [ca * ce, sa * ce, se]];
  }
  // Show the whole motion, by (CM1) of page.py.
  function fit() {
    const { clientWidth: width, clientHeight: height } = canvas, at = axes(), points = [];
    const size = [width, height].map(x => 0.41 * x / Math.min(width, height));
    for (let k = 0; k < 40; k++)
      data.runs.forEach((_, r) => {
        const t = data.begin + (data.end - data.begin) * k / 39;
        for (const [a, b] of [...capsules(r, 'q', t), ...capsules(r, 'q_d', t)])
          for (const x of [a, b]) points.push(at.map(axis => dot(axis, x)));
      });
    if (!points.length) return;
    const most = i => Math.max(...points.map(x => x[2] + x[i] / size[i]));
    const least = i => Math.max(...points.map(x => x[2] - x[i] / size[i]));
    const depth = points.reduce((sum, x) => sum + x[2], 0) / points.length;
    const middle = [0, 1].map(i => size[i] * (most(i) - least(i)) / 2).concat(depth);
    view.target = [0, 1, 2].map(j => dot(middle, at.map(axis => axis[j])));
    view.distance = Math.max(...[0, 1].map(i => (most(i) + least(i)) / 2)) - depth;
  }
  function prepared() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    const [wide, high] = [width, height].map(x => Math.round(x * ratio));
    if (canvas.width !== wide || canvas.height !== high) {
      canvas.width = wide;
      canvas.height = high;
    }
    const context = canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return [context, width, height];
  }
  function draw() {
    const [context, width, height] = prepared();
    const scale = Math.min(width, height), at = axes();
    const seen = point => {
      const [x, y, near] = at.map(axis => dot(axis, point.map((p, i) => p - view.target[i])));
      const depth = view.distance - near;
      return [width / 2 + scale * x / depth, height / 2 - scale * y / depth, depth];
    };
    const line = (a, b, colour, thick) => {
      Object.assign(context, { strokeStyle: colour, lineWidth: thick, lineCap: 'round' });
      context.beginPath();
      context.moveTo(a[0], a[1]);
      context.lineTo(b[0], b[1]);
      context.stroke();
    };
    const grid = getComputedStyle(document.documentElement).getPropertyValue('--grid');
    const end = 2 * data.reach, low = data.floor;
    for (let i = -4; i <= 4; i++)
      for (let j = -8; j < 8; j++) {  // Without what is behind the eye.
        const [across, from, to] = [i * data.reach / 2, j * end / 8, (j + 1) * end / 8];
        for (const ends of [[[across, from, low], [across, to, low]],
          [[from, across, low], [to, across, low]]]) {
          const [a, b] = ends.map(seen);
          if (Math.min(a[2], b[2]) > 0.05 * view.distance) line(a, b, grid, 1);
        }
      }
    const found = [];
    data.runs.forEach((_, r) => {
      for (const [signal, opacity, size] of [['q_d', 0.5, 1.35], ['q', 1, 1]])
        for (const [a, b, radius] of capsules(r, signal, now)) {
          const [from, to] = [seen(a), seen(b)], depth = (from[2] + to[2]) / 2;
          found.push({ from, to, signal, opacity, thick: 2 * size * radius * scale / depth,
            order: depth - (signal === 'q' ? 0.01 : 0) });
        }
    });
    for (const { from, to, signal, opacity, thick } of found.sort((a, b) => b.order - a.order)) {
      context.globalAlpha = opacity;
      if (signal === 'q') line(from, to, '#00405f', thick);
      line(from, to, signal === 'q' ? '#0072b2' : '#e69f00',
        signal === 'q' ? 0.75 * thick : thick);
      context.globalAlpha = 1;
    }
  }

  // --- mouse, fingers, changes of the window
  let from = null;
  canvas.onpointerdown = event => {
    from = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  };
  canvas.onpointermove = event => {
    if (!from) return;
    view.azimuth -= (event.clientX - from[0]) / 150;
    view.elevation += (event.clientY - from[1]) / 150;
    view.elevation = Math.min(1.5, Math.max(-1.5, view.elevation));
    from = [event.clientX, event.clientY];
    draw();
  };
  canvas.onpointerup = () => { from = null; };
  canvas.onwheel = event => {
    event.preventDefault();
    view.distance *= Math.exp(event.deltaY / 1000);
    draw();
  };
  addEventListener('resize', draw);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', draw);
  fit();
  return t => {
    now = t;
    draw();
  };
};
