// The view of viser in its frame: by day or by night, with the camera that this browser had last.
// viser takes both from its address, and prints the camera whenever it moves.
//
//   const arms = ctcView(frame, {read, write}, say);   // of an object that the browser keeps
//   arms(name);   // which arms there are: a camera for others is of no use
'use strict';
const ctcView = (frame, store, say) => {
  const CAMERA = /^(&initialCamera(Position|LookAt|Up|Fov|Near|Far)=[-+.,e\d]{1,80}){1,6}$/;
  const night = matchMedia('(prefers-color-scheme: dark)');
  let scene = null, moved = false, timer = 0;
  const kept = () => {
    const camera = store.read().camera;
    return camera && CAMERA.test(camera.words) ? camera : null;
  };
  const open = () => {
    const camera = kept(), mine = camera && (scene === null || camera.scene === scene);
    moved = false;
    frame.src = `/view/?logCamera${night.matches ? '&darkMode' : ''}${mine ? camera.words : ''}`;
  };
  frame.addEventListener('load', () => {
    const inside = frame.contentWindow, log = inside.console.log;
    inside.console.log = (...words) => {
      if (!CAMERA.test(words[0])) { log.apply(inside.console, words); return; }
      clearTimeout(timer);
      if (moved && scene !== null) timer = setTimeout(
        () => store.write({ camera: { scene, words: words[0] } }), 300);
    };
    // Only a camera that was moved by hand is kept; until then the server's shows the arms.
    for (const kind of ['pointerdown', 'wheel', 'keydown'])
      inside.addEventListener(kind, event => {
        if (moved || (event.target.tagName !== 'CANVAS' && kind !== 'keydown')) return;
        moved = true;
        say({ moved: null });
      }, { capture: true, passive: true });
    // Its own panel has nothing of ours.
    const style = inside.document.createElement('style');
    style.textContent = '.mantine-Paper-root { display: none !important; }';
    inside.document.head.append(style);
    seldom(inside);
  });
  // Without a graphics card the view takes all of the processor: where a frame comes late, the next
  // one waits twice as long, so that the plots have their turn.
  function seldom(inside) {
    const draw = inside.requestAnimationFrame.bind(inside), waiting = new Set();
    let late = 0, last = 0;
    inside.requestAnimationFrame = done => {
      const id = ++last, ask = () => {
        const begin = performance.now();
        draw(now => {
          if (waiting.delete(id)) done(now);
          late = performance.now() - begin;
        });
      };
      waiting.add(id);
      if (late > 50) setTimeout(ask, Math.min(500, 2 * late)); else ask();
      return id;
    };
    inside.cancelAnimationFrame = id => waiting.delete(id);
  }
  const shape = () => say({ aspect: Math.min(3, Math.max(
    0.3, frame.clientWidth / frame.clientHeight || 1)) });
  new ResizeObserver(shape).observe(frame);
  night.addEventListener('change', open);
  open();
  return name => {
    const before = kept();
    scene = name;
    shape();
    if (before?.scene === name) say({ moved: null });
    else if (before) { store.write({ camera: null }); open(); }
  };
};
