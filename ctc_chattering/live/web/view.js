// The view of viser in its frame: by day or by night, which viser takes from its address.
//
//   const shape = ctcView(frame, say);   // tells the server what shape the view has
'use strict';
const ctcView = (frame, say) => {
  const night = matchMedia('(prefers-color-scheme: dark)');
  let moved = false;
  const open = () => {
    moved = false;
    frame.src = `/view/${night.matches ? '?darkMode' : ''}`;
  };
  frame.addEventListener('load', () => {
    const inside = frame.contentWindow;
    // One that was moved by hand stays; until then the server's shows the arms.
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
  return shape;
};
