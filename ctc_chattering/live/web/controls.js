// Controls of a running graph. controls.html has their elements, controls.py their state.
//
//   const update = ctcControls(parent, send);   // send(requests), by subject
//   update(state);                              // state of `Controls.state`
'use strict';
const ctcControls = (parent, send) => {
  const $ = selector => parent.querySelector(selector);
  const digits = x => String(Number(x.toPrecision(4)));
  const wordsIn = text => text.match(/[^\s,[\]]+/g) ?? [];
  const numbersIn = text => wordsIn(text).map(Number);
  let state = null;

  // --- fields of numbers: a wrong one is marked at once, with the reason below it
  function makeField(into, label, reasonFor) {
    const row = $('template').content.firstElementChild.cloneNode(true);
    const [title, input, wrong] = row.children;
    into.append(row);
    title.textContent = label;
    input.setAttribute('aria-label', label);
    const check = () => {
      wrong.textContent = reasonFor(input.value);
      input.setAttribute('aria-invalid', String(Boolean(wrong.textContent)));
      return !wrong.textContent;
    };
    input.addEventListener('input', check);
    return { row, title, input, check };
  }
  function reasonAgainst(text, count, low = -Infinity, high = Infinity) {
    const words = wordsIn(text);
    if (![1, count].includes(words.length))
      return count > 1 ? `Enter one number, or ${count} numbers.` : 'Enter one number.';
    const odd = words.find(word => !Number.isFinite(Number(word)));
    if (odd) return `${odd} is not a number.`;
    return words.some(x => x < low || x > high) ? `The range is ${low} to ${high}.` : '';
  }

  // --- law and switching: the one in force is pressed
  function choose(name, value, choices) {
    const row = $(`[data-choice=${name}]`);
    row.hidden = value === null;
    for (const choice of choices) {
      let button = [...row.children].find(x => x.value === choice);
      if (!button) {
        button = ctcElement('button', row, choice);
        Object.assign(button, { type: 'button', value: choice });
        button.onclick = () => send({ [name]: choice });
      }
      button.setAttribute('aria-pressed', String(choice === value));
    }
  }

  // --- gains: sliders of the logarithm, sent on release, and numbers, sent on Enter
  const gains = new Map();
  const joint = () => Number($('#joints').value);  // -1 for all joints.
  const isOfAll = ({ values }) => values.length === 1 || joint() < 0;
  const valuesInForce = gain => (isOfAll(gain) ? gain.values : [gain.values[joint()]]);
  function makeGain(name) {
    const it = makeField($('#gains .ctc-fields'), `${name} as a number`, text => reasonAgainst(
      text, valuesInForce(it.gain).length, ...it.gain.bounds));
    const slide = it.slide = document.createElement('input');
    Object.assign(slide, { type: 'range', min: 0, max: 1, step: 'any' });
    slide.setAttribute('aria-label', name);
    it.title.after(slide);
    it.input.inputMode = 'decimal';
    const ask = entered => {
      const { values } = it.gain;
      Object.assign(it, { held: false, asked: { answered: state.answered, at: Date.now() } });
      send({ gain: { name, values: isOfAll(it.gain) ? entered
        : values.map((x, i) => (i === joint() ? entered[0] : x)) } });
    };
    slide.oninput = () => {
      const { low, high } = it.gain;
      it.held = true;
      it.input.value = digits(Number((low * (high / low) ** slide.value).toPrecision(3)));
      it.check();
    };
    slide.onchange = () => {
      slide.oninput();
      const value = Number(it.input.value), { values } = it.gain, largest = Math.max(...values);
      // For all joints the values keep their ratios.
      ask(isOfAll(it.gain) ? values.map(x => (largest ? value * (x / largest) : value)) : [value]);
    };
    it.input.addEventListener('input', () => { it.held = true; });
    it.input.onchange = () => { if (it.check()) ask(numbersIn(it.input.value)); };
    it.input.onblur = slide.onblur = () => { it.held = false; showGain(it); };
    gains.set(name, it);
    return it;
  }
  // Show the value in force, unless the user holds the slider or waits for an answer.
  function showGain(it) {
    const { gain: { name, unit, about, low, high }, asked } = it;
    const values = valuesInForce(it.gain), value = Math.max(...values);
    it.row.title = about;
    it.title.textContent = `${name} [${unit}]`;
    if (asked && (state.answered > asked.answered || Date.now() - asked.at > 5000)) it.asked = null;
    if (it.held || it.asked) return;
    it.slide.value = value > 0 ? Math.log(value / low) / Math.log(high / low) : 0;
    it.input.value = (new Set(values).size > 1 ? values : [value]).map(digits).join(', ');
    it.row.classList.toggle('ctc-several', it.input.value.includes(','));
    it.check();
  }
  $('#joints').onchange = () => gains.forEach(showGain);

  // --- torques, recording, plant
  $('#enable').onclick = () => send({ torques: true });
  $('#disable').onclick = () => send({ torques: false });
  for (const button of $('#motion').querySelectorAll('[value]'))
    button.onclick = () => send({ move: button.value });
  for (const button of $('#learning').querySelectorAll('button'))
    button.onclick = () => send({ learning: button.value });
  $('#guide').onclick = () => send({ guide: true });
  $('#hold').onclick = () => send({ guide: false });
  for (const name of ['speed', 'payload']) {
    const input = $(`#${name}`);
    input.onchange = () => { if (input.checkValidity()) send({ [name]: Number(input.value) }); };
  }
  // Show the value in force, unless the user is at it.
  function showValue(name, value) {
    const input = $(`#${name}`);
    input.parentElement.hidden = value === undefined || value === null;
    if (document.activeElement !== input) input.value = value;
  }
  $('#record').onclick = () => send({ record: state.record.state === 'off' });
  const RECORD = { off: '● record', starting: 'starting …', on: '■ stop recording',
    stopping: 'stopping …' };
  const fields = new Map();
  $('#apply').onclick = () => {
    for (const [name, { input, check, shown }] of fields)
      if (check() && input.value !== shown)
        send({ plant: { name, values: numbersIn(input.value) } });
  };
  // The browser checks the numbers of a form.
  function onSubmit(form, request) {
    form.onsubmit = event => {
      event.preventDefault();
      send(request(name => Number(form.elements[name].value), event.submitter.value));
    };
  }
  onSubmit($('#push form'), number => ({ push: {
    joint: number('joint'), torque: number('torque'), duration: number('duration') } }));
  onSubmit($('#simulated form'), (number, action) => ({ time: {
    action, samples: number('samples') } }));

  function setOptions(select, texts, first) {
    if (texts.join('\n') === [...select.options].map(x => x.text).join('\n')) return;
    select.replaceChildren(...texts.map((text, i) => new Option(text, first + i)));
  }
  return now => {
    state = now;
    parent.hidden = false;
    choose('law', state.law, new Set([...state.laws, state.law].filter(Boolean)));
    choose('switching', state.switching, state.switchings);
    setOptions($('#joints'), ['all joints', ...state.joints], -1);
    setOptions($('#push select'), state.joints, 0);
    $('#gains').hidden = !state.gains.length;
    for (const it of gains.values()) it.row.hidden = true;
    for (const gain of state.gains) {
      const it = gains.get(gain.name) ?? makeGain(gain.name);
      it.gain = gain;
      it.row.hidden = false;
      showGain(it);
    }
    $('#learning').hidden = !state.learning;
    showValue('speed', state.speed);
    showValue('payload', state.payload);
    const { state: recorder, path, duration } = state.record;
    $('#record').textContent = RECORD[recorder];
    $('#record').disabled = ['starting', 'stopping'].includes(recorder);
    $('#record').setAttribute('aria-pressed', String(recorder === 'on'));
    $('#bag').textContent = recorder === 'off' ? `in ${path}` : `${path}, ${duration} s`;
    $('#plant').hidden = $('#push').hidden = !state.plant.length;
    for (const { name, title, value } of state.plant) {
      if (!fields.has(name)) fields.set(name, makeField(
        $('#plant .ctc-fields'), title, text => reasonAgainst(text, state.joints.length)));
      const it = fields.get(name);
      if (it.shown !== value) {
        it.shown = it.input.value = value;
        it.check();
      }
    }
    for (const button of $('#simulated form').querySelectorAll('button'))
      button.disabled = Boolean(state.time_runs_on);
    $('.ctc-reason').textContent = state.time_runs_on;
  };
};
