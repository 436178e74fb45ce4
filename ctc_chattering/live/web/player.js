// Play, pause, speed and a slider of time: live.html of bags, and export.html.
//
//   const follow = ctcPlayer(parent, begin, end, moved);
//
// `moved` is called with every new time [s]. `follow(t, true)` goes to a time that was clicked.
// `follow(t)` goes to the time of another page, and returns false while the user moves this one.
'use strict';
const ctcPlayer = (parent, begin, end, moved) => {
  parent.innerHTML = `<div class="ctc-bar"><span>time</span>
    <button id="play" type="button">play</button>
    <input id="time" type="range" step="0.001" aria-label="time [s]"><output id="now"></output>
    <select id="speed" aria-label="speed"></select></div>`;
  const [play, time, now, speed] = ['play', 'time', 'now', 'speed'].map(
    id => parent.querySelector(`#${id}`));
  for (const factor of [0.1, 0.25, 0.5, 1, 2, 5, 10])
    speed.append(new Option(`speed × ${factor}`, factor, factor === 1, factor === 1));
  let t = begin, playing = false, last = 0, changed = -Infinity;
  time.min = begin;
  time.max = end;
  function show() {
    time.value = t;
    now.textContent = `${t.toFixed(3)} s`;
  }
  function seek(to) {
    t = Math.min(Math.max(to, begin), end);
    changed = performance.now();
    show();
    moved(t);
  }
  function tick(at) {
    if (!playing) return;
    seek(t + (at - last) / 1000 * Number(speed.value));
    last = at;
    if (t < end) requestAnimationFrame(tick); else toggle();
  }
  function toggle() {
    playing = !playing;
    play.textContent = playing ? 'pause' : 'play';
    if (!playing) return;
    if (t >= end) t = begin;
    last = performance.now();
    requestAnimationFrame(tick);
  }
  play.onclick = toggle;
  time.oninput = () => seek(Number(time.value));
  show();
  return (to, clicked = false) => {
    if (clicked) seek(to);
    if (clicked || playing || performance.now() - changed < 1000) return false;
    t = to;
    show();
    return true;
  };
};
