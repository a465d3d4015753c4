'use strict';
// The panels of a flight at one moment. `Panels(root)` builds them; show(view), path(path) and profile(profile) fill
// them. A report shows the same panels as a page that is live.
const Panels = (root) => {
  const make = (tag, content = '', kind = '') => {
    const one = document.createElement(tag);
    one.textContent = content;
    if (kind) one.className = kind;
    return one;
  };
  const panel = (title, note = '', kind = '') => {
    const box = make('section', '', kind), head = make('h2', title + ' ');
    head.append(make('small', note));
    box.append(head);
    root.append(box);
    return box;
  };
  const canvas = (box, label) => {
    const one = make('canvas');
    one.setAttribute('role', 'img');
    one.setAttribute('aria-label', label);
    box.append(one);
    return one;
  };
  root.classList.add('cp');
  const mission = panel('Mission'), health = panel('Health', 'worst first');
  const state = make('p', '', 'state'), next = make('p'), reason = make('p'), missing = make('ul');
  state.id = 'state';
  mission.append(state, next, reason, missing);
  const list = make('ul');
  list.id = 'health';
  health.append(list);
  const map = canvas(panel('Map', 'local frame, North up'), 'map: path, fence, bearings and target from above');
  const bearingBox = panel('Bearing', 'compass, North up'), polar = canvas(bearingBox, 'bearing with its deviation');
  const bearingText = make('p'), targetText = make('p');
  bearingText.id = 'bearing';
  bearingBox.append(bearingText, targetText);
  const profileBox = panel('AOA profile', 'power over direction'), heat = canvas(profileBox, 'heat map of the AOA profile');
  const profileText = make('p');
  profileBox.append(profileText);
  const rates = panel('Rates and link'), table = make('table');
  rates.append(table);
  const told = panel('Events', 'newest first'), events = make('ul', '', 'events');
  told.append(events);

  const known = {view: null, path: {trail: [], bearings: []}, profile: null};
  const number = (value, unit, digits = 0) => value === null || value === undefined ? '–' : `${value.toFixed(digits)} ${unit}`;
  const signs = {bad: '✖', warning: '!', ok: '✓'};
  const compass = azimuth => ((90 - azimuth) % 360 + 360) % 360;

  function sayBearing(view) {
    const b = view.bearing, t = view.target;
    const refused = view.refusal ? ` Newest aperture refused: ${view.refusal.why}.` : '';
    if (!b) { bearingText.textContent = `No bearing yet.${refused}`; } else {
      const deviation = b.azimuth_std_deg === null ? ', deviation not known' : ` ± ${b.azimuth_std_deg.toFixed(1)}°`;
      const up = b.elevation_deg === null ? 'elevation not observable' :
        `elevation ${b.elevation_deg.toFixed(1)}°${b.elevation_std_deg === null ? '' : ` ± ${b.elevation_std_deg.toFixed(1)}°`}`;
      bearingText.textContent = `Compass ${compass(b.azimuth_deg).toFixed(0)}°${deviation} ` +
        `(${b.azimuth_deg.toFixed(1)}° from East), ${up}, reliability ${b.reliability.toFixed(2)}, ` +
        `${b.packets} packets over ${b.length_m.toFixed(2)} m.${refused}`;
    }
    const name = view.target_name ? `Target ${view.target_name}` : 'Target';
    targetText.textContent = t ? `${name} ${number(t.range_m, 'm', 1)} ± ${number(t.range_std_m, 'm', 1)} away` +
      `${t.range_m !== null && t.range_std_m > 0.3 * t.range_m ? ', its range hardly known' : ''}` +
      `${t.probability === null ? '' : `, ${Math.round(100 * t.probability)} % sure of this place`}` +
      `${t.rivals.length ? `, ${t.rivals.length} other${t.rivals.length > 1 ? 's' : ''} possible` : ''}.` : `Nothing known of the target${view.target_name ? `, ${view.target_name}` : ''}.`;
  }

  function sayMission(view) {
    const m = view.mission;
    if (!m) return;
    state.textContent = m.state.replace('_', ' ') || '–';
    next.textContent = m.next;
    reason.textContent = m.reason ? `Why: ${m.reason}` : '';
    missing.replaceChildren(...(m.not_ready || []).map(one => make('li', `· ${one}`)));
  }

  function sayHealth(items) {
    list.replaceChildren(...items.map(item => {
      const line = make('li', '', item.level);
      line.append(make('b', signs[item.level]), `${item.name}: ${item.text} `);
      if (item.todo) line.append(make('span', item.todo, 'todo'));
      return line;
    }));
    if (!items.length) list.append(make('li', '–'));
  }

  function sayRates(view) {
    const r = view.rates || {}, v = view.vehicle;
    const rows = [['packets', number(r.packets_hz, '/s')], ['paired', number(r.paired_percent, '%')],
      ['poses', number(r.poses_hz, '/s')], ['datagrams', number(r.datagrams_hz, '/s')],
      ['newest datagram', number(r.datagram_age_s, 's ago', 1)], ['set points', number(r.setpoints_hz, '/s', 1)],
      ['battery', v && v.battery !== null ? `${Math.round(100 * v.battery)} %` : '–'],
      ['link', v && v.heartbeat_age_s !== null ? `heartbeat ${v.heartbeat_age_s.toFixed(1)} s ago` : '–'],
      ['vehicle', v ? `${v.mode || 'mode unknown'}, ${v.armed ? 'armed' : 'disarmed'}, ${v.in_air === null ? 'not known whether in the air' : v.in_air ? 'in the air' : 'on the ground'}` : '–'],
      ['position E, N, up', v && v.p_m ? `${v.p_m.map(one => (Math.round(10 * one) / 10 + 0).toFixed(1)).join(', ')} m` : '–'],
      ['log', r.log_written === null || r.log_written === undefined ? '–' : `${r.log_written} written, ${r.log_dropped} dropped`],
      ['disk free', number(r.disk_free_gib, 'GiB', 1)]];
    table.replaceChildren(...rows.map(([name, value]) => {
      const row = make('tr');
      row.append(make('th', name), make('td', value));
      return row;
    }));
  }

  function sayEvents(lines) {
    events.replaceChildren(...lines.slice().reverse().map(one => make('li', `${one.t_s.toFixed(1)} s  ${one.kind}: ${one.text}`)));
  }

  function draw() {
    if (!known.view) return;
    Draw.map(map, known.view, known.path);
    Draw.polar(polar, known.view);
    Draw.profile(heat, known.profile, known.view.bearing);
    profileText.textContent = known.profile ? `Of SAR iteration ${known.profile.number}.` : '';
  }

  window.addEventListener('resize', draw);
  return {
    mission,
    show(view) {
      known.view = view;
      sayMission(view);
      sayHealth(view.health);
      sayBearing(view);
      sayRates(view);
      sayEvents(view.events || []);
      draw();
    },
    path(path) { known.path = path; },
    profile(profile) { known.profile = profile; },
    redraw: draw,
  };
};
