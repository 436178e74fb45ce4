// viser's view in its frame, light or dark, which viser takes from its address.
//
//   const sendShape = ctcView(frame, send);   // sends the shape of the view
'use strict';
const ctcView = (frame, send) => {
  const dark = matchMedia('(prefers-color-scheme: dark)');
  let moved = false;
  const open = () => {
    moved = false;
    frame.src = `/view/${dark.matches ? '?darkMode' : ''}`;
  };
  frame.addEventListener('load', () => {
    const inside = frame.contentWindow;
    // A camera that the user moves stays.
    for (const kind of ['pointerdown', 'wheel', 'keydown'])
      inside.addEventListener(kind, event => {
        if (moved || (event.target.tagName !== 'CANVAS' && kind !== 'keydown')) return;
        moved = true;
        send({ moved: null });
      }, { capture: true, passive: true });
    // viser's own panel is empty.
    const style = inside.document.createElement('style');
    style.textContent = '.mantine-Paper-root { display: none !important; }';
    inside.document.head.append(style);
    seldom(inside);
  });
  // Without a graphics card the view takes all of the processor. After a late frame the next one
  // waits twice as long, so that the plots have their turn.
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
  const sendShape = () => send({ aspect: Math.min(3, Math.max(
    0.3, frame.clientWidth / frame.clientHeight || 1)) });
  new ResizeObserver(sendShape).observe(frame);
  dark.addEventListener('change', open);
  open();
  return sendShape;
};
