// The page of `ctc live`: its parts, the WebSocket that feeds them, and the line between plots and
// view. The words of both sides: page_socket.py.
'use strict';
// The cookie has the token: neither address bar nor history keep it.
history.replaceState(null, '', location.pathname);
const STORE = 'ctc-live', $ = id => document.getElementById(id);
let plots = null, numbers = null, player = null, about = [], socket = null;
// The time under the pointer in a plot, null for none: the numbers are those there.
let pointed = null;
const say = words => { if (socket?.readyState === 1) socket.send(JSON.stringify(words)); };

// --- what the browser keeps
function remembered() {
  try { return JSON.parse(localStorage.getItem(STORE)) || {}; } catch { return {}; }
}
function remember(values) {
  try {
    localStorage.setItem(STORE, JSON.stringify({ ...remembered(), ...values }));
  } catch { /* Then nothing is remembered. */ }
}

// --- the time of bags: shown here, and told to the server often enough for the arm
let due = 0, shown = null;
function moved(t) {
  plots.mark(t);
  shown = t;
  showNumbers();
}
function showNumbers(silent = 0) {
  if (pointed !== null) numbers(plots.runs, about, pointed, 0, 'at the pointer');
  else numbers(plots.runs, about, player && shown, silent);
}
function seek(t) {
  moved(t);
  due ||= setTimeout(() => { due = 0; say({ seek: shown }); }, 33);
}

// --- what the server says
const status = ctcStatus($('light'), $('reports'), $('log'));
const receivers = {
  show({ joints, units, runs, options, note, time }) {
    plots?.remove();
    $('note').textContent = note;
    numbers = ctcNumbers($('numbers'), joints);
    about = runs;
    if (time) player = ctcPlayer($('player'), ...time, seek);
    plots = ctcPlots.mount($('plots'), { joints, units, runs: runs.map(
      ({ name, received }) => ({ name, received })) },
      { ...options, wheel: 'always', storage: 'ctc-plots', onSeek: time && (t => player(t, true)),
        onPoint: t => { pointed = t; if (player || t !== null) showNumbers(); } });
  },
  mark(t) { if (player(t)) moved(t); },
  silent(seconds) { if (plots) showNumbers(seconds); },
  controls: ctcControls($('controls'), say),
  scene: ctcView($('view'), say),
  ended(text) { $('ended').textContent = text; $('ended').hidden = !text; },
  ...status,
  reports(nodes) { $('reports').parentElement.hidden = false; status.reports(nodes); },
};
function connect() {
  socket = new WebSocket(`${location.origin.replace('http', 'ws')}/samples`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    $('panel').inert = false;
    $('note').className = '';
  };
  socket.onmessage = ({ data }) => {
    if (typeof data !== 'string') { plots?.append(data); return; }
    for (const [subject, value] of Object.entries(JSON.parse(data))) receivers[subject]?.(value);
  };
  socket.onclose = () => {
    $('panel').inert = true;
    $('note').className = 'ended';
    $('note').textContent = 'ctc live has ended or does not answer; the plots have the last samples.';
    setTimeout(connect, 3000);
  };
}
connect();

// --- the view: magnified errors, the camera, a picture
$('magnify').onchange = () => say({ magnify: Number($('magnify').value) });
$('fit').onclick = () => say({ fit: null });
$('picture').onclick = () => {
  const canvas = $('view').contentDocument.querySelector('canvas[data-engine]');
  canvas.toBlob(blob => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(blob);
    link.download = `arm_${new Date().toISOString().slice(0, 19).replace(/:/g, '.')}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  });
};

// --- the line between plots and view
function widen(part) {
  const width = Math.min(0.7, Math.max(0.15, part));
  document.body.style.setProperty('--width', `${(100 * width).toFixed(1)}%`);
  return width;
}
let share = widen(Number(remembered().width) || 0.4);
$('divider').onpointerdown = event => $('divider').setPointerCapture(event.pointerId);
$('divider').onpointermove = event => {
  if (event.buttons) share = widen(event.clientX / innerWidth);
};
$('divider').onpointerup = () => remember({ width: share });
$('divider').onkeydown = ({ key }) => {
  share = widen(share + ({ ArrowLeft: -0.02, ArrowRight: 0.02 }[key] || 0));
  remember({ width: share });
};
