'use strict';
// A flight in a report: a slider over its time sets the panels of the page to what was known at that moment.
(() => {
  const flight = JSON.parse(document.getElementById('flight').textContent);
  const slider = document.getElementById('moment'), out = document.getElementById('time'), play = document.getElementById('play');
  const panels = Panels(document.getElementById('panels'));
  const box = document.createElement('section'), head = document.createElement('h2'), distance = document.createElement('canvas');
  head.textContent = 'Distance to the target';
  distance.setAttribute('role', 'img');
  distance.setAttribute('aria-label', 'distance to the target over time');
  box.append(head, distance);
  document.getElementById('panels').append(box);
  const end = Number(slider.max), shades = {image: null};

  // The newest row at or before a time; rows are sorted by what `time` says.
  const newest = (rows, t, time = row => row[0]) => {
    let low = 0, high = rows.length;
    while (low < high) { const middle = (low + high) >> 1; if (time(rows[middle]) <= t) low = middle + 1; else high = middle; }
    return low ? rows[low - 1] : null;
  };
  const until = (rows, t, time) => rows.filter(row => time(row) <= t);
  const at = row => row.t_s;

  function vehicle(t) {
    const row = newest(flight.track, t), mode = newest(flight.modes, t);
    if (!row || !mode) return null;
    return {name: mode[1], mode: mode[2], armed: mode[3], in_air: mode[4], failsafe: mode[5],
      p_m: row[1] === null ? null : row.slice(1, 4), yaw_deg: row[4], battery: row[5], heartbeat_age_s: row[6]};
  }

  function mission(t) {
    const row = newest(flight.missions, t);
    return row ? {state: row[1], reason: row[2], next: row[3], not_ready: []} : {state: 'idle', reason: '', next: '', not_ready: []};
  }

  function rates(t) {
    const row = newest(flight.rates, t) || [];
    const [, packets_hz, paired_percent, poses_hz, datagrams_hz, datagram_age_s, setpoints_hz, log_written, log_dropped] = row;
    return {packets_hz, paired_percent, poses_hz, datagrams_hz, datagram_age_s, setpoints_hz, log_written, log_dropped};
  }

  function profile(bearing) {
    if (!shades.image || !bearing) return null;
    const all = flight.profiles, index = all.numbers.lastIndexOf(newest(all.numbers, bearing.number, number => number));
    if (index < 0) return null;
    const size = all.rows * all.columns, from = 4 * size * index, cells = new Uint8Array(size);
    for (let k = 0; k < size; k += 1) cells[k] = shades.image.data[from + 4 * k];
    return {number: all.numbers[index], rows: all.rows, columns: all.columns, cells};
  }

  function show() {
    const t = Number(slider.value), bearing = newest(flight.bearings, t, at), health = newest(flight.health, t);
    const refusal = newest(flight.refusals, t, at);
    out.textContent = `${t.toFixed(1)} s`;
    panels.path({trail: until(flight.track, t, row => row[0]).filter(row => row[1] !== null).map(row => row.slice(1, 4)),
      bearings: until(flight.bearings, t, at).filter(one => one.p_m).map(one => [one.p_m[0], one.p_m[1], one.azimuth_deg, one.reliability])});
    panels.profile(profile(bearing));
    panels.show({vehicle: vehicle(t), mission: mission(t), bearing, target: newest(flight.targets, t, at),
      refusal: refusal && (!bearing || refusal.t_s > bearing.t_s) ? refusal : null, fence: flight.about.fence,
      health: health ? health[1] : [], rates: rates(t), events: until(flight.events, t, at).slice(-30), truth: flight.truth.places || []});
    const believed = flight.targets.map(one => [one.t_s, one.range_m]);
    const lines = [['believed', Colours.target, [4, 3], believed]];
    if (flight.truth.distance) lines.push(['true', Colours.ink, [], flight.truth.distance]);
    Draw.chart(distance, lines, 'm', t);
  }

  let running = null;
  function stop() { clearInterval(running); running = null; play.textContent = 'Play'; }
  play.addEventListener('click', () => {
    if (running) { stop(); return; }
    if (Number(slider.value) >= end) slider.value = 0;
    play.textContent = 'Stop';
    running = setInterval(() => { slider.value = Math.min(end, Number(slider.value) + 0.5); show(); if (Number(slider.value) >= end) stop(); }, 100);
  });
  slider.addEventListener('input', show);
  window.addEventListener('resize', show);
  if (flight.profiles) {
    const picture = new Image();
    picture.addEventListener('load', () => {
      const canvas = document.createElement('canvas');
      canvas.width = picture.width;
      canvas.height = picture.height;
      const pen = canvas.getContext('2d', {willReadFrequently: true});
      pen.drawImage(picture, 0, 0);
      shades.image = pen.getImageData(0, 0, picture.width, picture.height);
      show();
    });
    picture.src = flight.profiles.png;
  }
  show();
})();
