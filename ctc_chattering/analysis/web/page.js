// The index of a narrow page begins folded; what is folded opens for a link to it, and for print.
const contents = document.querySelector('nav details');
if (contents && matchMedia('(max-width: 1099px)').matches) {
  contents.open = false;
  contents.addEventListener('click', event => { if (event.target.tagName === 'A') contents.open = false; });
}
function open() {
  const target = location.hash.length > 1 && document.getElementById(location.hash.slice(1));
  for (let x = target; x; x = x.parentElement) if (x.tagName === 'DETAILS') x.open = true;
}
addEventListener('hashchange', open);
open();
let unfolded = [];
addEventListener('beforeprint', () => {
  unfolded = [...document.querySelectorAll('main details:not([open])')];
  for (const x of unfolded) x.open = true;
});
addEventListener('afterprint', () => { for (const x of unfolded) x.open = false; });
// The signals of runs: their files are read when the plots come into view.
window.ctcSamples = {};
function loaded(path) {
  return new Promise((done, failed) => {
    const script = document.createElement('script');
    script.src = path;
    script.onload = done;
    script.onerror = () => failed(new Error(`${decodeURI(path)} is missing`));
    document.head.append(script);
  });
}
async function mount(element) {
  const { joints, units, runs, mark, signals, settled } = JSON.parse(element.textContent);
  try {
    await Promise.all(runs.map(run => ctcSamples[run.key] || loaded(run.path)));
    const packed = await Promise.all(runs.map(
      run => Promise.all(ctcSamples[run.key].map(ctcPlots.inflated))));
    element.textContent = '';
    const plots = ctcPlots.mount(element, { joints, units, runs: runs.map(
      (run, r) => ({ ...run, packed: packed[r] })) }, { signals, settled });
    if (mark !== null) plots.mark(mark);
  } catch (error) {
    element.replaceChildren(Object.assign(document.createElement('p'), { textContent: error.message }));
  }
}
const seen = new IntersectionObserver(entries => {
  for (const { isIntersecting, target } of entries)
    if (isIntersecting) { seen.unobserve(target); mount(target); }
}, { rootMargin: '300px' });
for (const element of document.querySelectorAll('.signals')) seen.observe(element);
// What scrolls sideways fades where there is more.
const wide = new ResizeObserver(entries => entries.forEach(({ target }) => fade(target)));
function fade(element) {
  const left = element.scrollLeft, more = element.scrollWidth - element.clientWidth - left;
  element.style.setProperty('--left', left > 1 ? '2.5rem' : '0px');
  element.style.setProperty('--right', more > 1 ? '2.5rem' : '0px');
}
for (const element of document.querySelectorAll('.scroll')) {
  element.addEventListener('scroll', () => fade(element));
  wide.observe(element);
}
