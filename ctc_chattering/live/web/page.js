// Page of `ctc live`: its parts, and the WebSocket that feeds them. page_socket.py lists the messages.
'use strict';
// The cookie has the token, so neither address bar nor history keep it.
history.replaceState(null, '', location.pathname);
const $ = id => document.getElementById(id);
let plots = null, numbers = null, player = null, about = [], socket = null;
// Time under the pointer in a plot, at which the numbers are shown.
let pointed = null;
const send = requests => {
  if (socket?.readyState === 1) socket.send(JSON.stringify(requests));
};

// --- time of bags: shown here, and sent to the server for the arm, 30 times a second
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
  due ||= setTimeout(() => { due = 0; send({ seek: shown }); }, 33);
}

// --- messages of the server
const status = ctcStatus($('light'), $('reports'), $('log'), $('passes'));
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
  controls: ctcControls($('controls'), send),
  scene: ctcView($('view'), send),
  ended(text) { $('ended').textContent = text; $('ended').hidden = !text; },
  ...status,
  reports(nodes) {
    $('reports').parentElement.hidden = false;
    status.reports(nodes);
    const [, , values] = nodes.find(([node]) => node === 'reference') ?? [, , []];
    status.passes(Object.fromEntries(values));
  },
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
    $('note').textContent = 'ctc live has ended or does not answer. The plots show the last samples.';
    setTimeout(connect, 3000);
  };
}
connect();

// --- the view: magnified errors, camera, picture
$('magnify').onchange = () => send({ magnify: Number($('magnify').value) });
$('fit').onclick = () => send({ fit: null });
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
