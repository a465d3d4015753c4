'use strict';
// Pictures on canvases: each function draws one, whole, from plain values. Angles in degrees, counter-clockwise from
// East; places in metres East and North of the local frame.
const Draw = (() => {
  const RAD = Math.PI / 180, C = Colours;

  function begin(canvas, ratio) {
    const width = Math.max(200, canvas.clientWidth || 320), height = Math.round(width * ratio);
    const dense = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) {
      canvas.width = Math.round(width * dense);
      canvas.height = Math.round(height * dense);
      canvas.style.height = `${height}px`;
    }
    const pen = canvas.getContext('2d');
    pen.setTransform(dense, 0, 0, dense, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = '12px system-ui, sans-serif';
    pen.lineWidth = 1.5;
    pen.setLineDash([]);
    pen.textAlign = 'left';
    pen.textBaseline = 'alphabetic';
    return {pen, width, height};
  }

  function line(pen, points, colour, dash = [], width = 1.5) {
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
    pen.stroke();
    pen.setLineDash([]);
  }

  function text(pen, words, x, y, colour = C.ink, align = 'left') {
    pen.textAlign = align;
    pen.lineWidth = 3;
    pen.strokeStyle = '#fff';
    pen.strokeText(words, x, y);
    pen.fillStyle = colour;
    pen.fillText(words, x, y);
    pen.textAlign = 'left';
  }

  function legend(pen, rows, x, y) {
    rows.forEach(([words, colour, dash, mark], k) => {
      const top = y + 15 * k;
      if (mark) { pen.fillStyle = colour; mark(pen, x + 11, top - 4); } else line(pen, [[x, top - 4], [x + 22, top - 4]], colour, dash);
      text(pen, words, x + 27, top, C.soft);
    });
  }

  const dot = (pen, x, y) => { pen.beginPath(); pen.arc(x, y, 3.5, 0, 7); pen.fill(); };
  const cross = (pen, x, y) => { pen.strokeStyle = pen.fillStyle; pen.lineWidth = 2; pen.beginPath();
    pen.moveTo(x - 4, y - 4); pen.lineTo(x + 4, y + 4); pen.moveTo(x - 4, y + 4); pen.lineTo(x + 4, y - 4); pen.stroke(); };

  // A length for an axis: 1, 2 or 5 times a power of ten, about `most` of them over a span.
  function step(span, most) {
    const raw = span / most, power = 10 ** Math.floor(Math.log10(raw));
    return [1, 2, 5, 10].map(k => k * power).find(one => one >= raw);
  }

  function fenceCorners(fence) {
    const turn = fence.fence_yaw_deg * RAD, [x0, y0] = fence.fence_min_m, [x1, y1] = fence.fence_max_m;
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]].map(([x, y]) =>
      [x * Math.cos(turn) - y * Math.sin(turn), x * Math.sin(turn) + y * Math.cos(turn)]);
  }

  // The map: path, fence, bearings, the target as it is believed, North up, a scale.
  function map(canvas, view, path) {
    const {pen, width, height} = begin(canvas, 0.85);
    const here = view.vehicle && view.vehicle.p_m, target = view.target && view.target.p_m ? view.target : null;
    const shown = path.trail.map(p => [p[0], p[1]]).concat(path.bearings.map(b => [b[0], b[1]]));
    if (here) shown.push([here[0], here[1]]);
    if (target) shown.push([target.p_m[0], target.p_m[1]]);
    (view.truth || []).forEach(one => shown.push([one.p_m[0], one.p_m[1]]));
    if (!shown.length) shown.push([0, 0]);
    const xs = shown.map(p => p[0]), ys = shown.map(p => p[1]);
    const low = [Math.min(...xs), Math.min(...ys)], high = [Math.max(...xs), Math.max(...ys)];
    const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    const left = 34, bottom = 26, inner = [width - left - 6, height - bottom - 6];
    const metre = Math.min(inner[0] / Math.max(6, 1.35 * (high[0] - low[0])),
      inner[1] / Math.max(6, 1.35 * (high[1] - low[1])));
    const at = ([x, y]) => [left + inner[0] / 2 + (x - middle[0]) * metre, 6 + inner[1] / 2 - (y - middle[1]) * metre];
    const grid = step(inner[0] / metre, 6);
    const from = [middle[0] - inner[0] / 2 / metre, middle[1] - inner[1] / 2 / metre];
    const to = [middle[0] + inner[0] / 2 / metre, middle[1] + inner[1] / 2 / metre];
    for (let x = Math.ceil(from[0] / grid) * grid; x <= to[0]; x += grid) {
      line(pen, [at([x, from[1]]), at([x, to[1]])], C.faint, [], 1);
      text(pen, `${+x.toFixed(1)}`, at([x, 0])[0], height - bottom + 16, C.soft, 'center');
    }
    for (let y = Math.ceil(from[1] / grid) * grid; y <= to[1]; y += grid) {
      line(pen, [at([from[0], y]), at([to[0], y])], C.faint, [], 1);
      text(pen, `${+y.toFixed(1)}`, left - 4, at([0, y])[1] + 4, C.soft, 'right');
    }
    pen.save();
    pen.beginPath();
    pen.rect(left, 6, inner[0], inner[1]);
    pen.clip();
    if (view.fence) {
      line(pen, fenceCorners(view.fence).map(at), C.fence, [8, 3, 2, 3]);
      pen.strokeStyle = C.fence; pen.setLineDash([2, 4]); pen.beginPath();
      pen.arc(...at([0, 0]), view.fence.fence_radius_m * metre, 0, 7); pen.stroke(); pen.setLineDash([]);
    }
    path.bearings.forEach(([x, y, azimuth, reliability]) => line(pen, [at([x, y]),
      at([x + 1.2 * Math.cos(azimuth * RAD), y + 1.2 * Math.sin(azimuth * RAD)])], C.soft, reliability < 0.1 ? [2, 3] : [], 1));
    line(pen, path.trail.map(at).concat(here ? [at(here)] : []), C.path, [], 2);
    (view.truth || []).forEach(one => { pen.fillStyle = C.ink; cross(pen, ...at(one.p_m)); });
    (view.robots || []).filter(robot => robot.place && robot.place.p_m && robot.name !== view.target_name).forEach(robot => {
      pen.fillStyle = C.soft; dot(pen, ...at(robot.place.p_m));
      text(pen, robot.name, at(robot.place.p_m)[0] + 9, at(robot.place.p_m)[1] + 4, C.soft); });
    if (target) {
      target.rivals.forEach(rival => { pen.strokeStyle = C.target; pen.lineWidth = 1.5; pen.setLineDash([2, 3]);
        pen.beginPath(); pen.arc(...at(rival.p_m), 7, 0, 7); pen.stroke(); pen.setLineDash([]);
        text(pen, `${Math.round(100 * rival.probability)} %`, at(rival.p_m)[0] + 9, at(rival.p_m)[1] + 4, C.target); });
      pen.fillStyle = C.target;
      dot(pen, ...at(target.p_m));
      if (target.ellipse) {
        const {major_m, minor_m, turn_deg} = target.ellipse;
        pen.strokeStyle = C.target; pen.lineWidth = 1.5; pen.beginPath();
        pen.ellipse(...at(target.p_m), 2 * major_m * metre, 2 * minor_m * metre, -turn_deg * RAD, 0, 7); pen.stroke();
      }
    }
    if (here) {
      const [x, y] = at(here), yaw = (view.vehicle.yaw_deg || 0) * RAD;
      pen.fillStyle = C.ink; pen.beginPath();
      [[11, 0], [-7, 6], [-4, 0], [-7, -6]].forEach(([f, l], k) => {
        const p = [x + f * Math.cos(yaw) - l * Math.sin(yaw), y - f * Math.sin(yaw) - l * Math.cos(yaw)];
        k ? pen.lineTo(...p) : pen.moveTo(...p); });
      pen.fill();
    }
    pen.restore();
    pen.strokeStyle = C.soft; pen.lineWidth = 1; pen.strokeRect(left, 6, inner[0], inner[1]);
    text(pen, 'East [m]', width - 8, height - bottom - 5, C.soft, 'right');
    text(pen, 'North [m]', left + 4, 18, C.soft);
    const arrow = [width - 20, 44];
    line(pen, [arrow, [arrow[0], arrow[1] - 28]], C.ink, [], 2);
    line(pen, [[arrow[0] - 5, arrow[1] - 20], [arrow[0], arrow[1] - 28], [arrow[0] + 5, arrow[1] - 20]], C.ink, [], 2);
    text(pen, 'N', arrow[0], arrow[1] + 13, C.ink, 'center');
    line(pen, [[left + 10, height - bottom - 10], [left + 10 + grid * metre, height - bottom - 10]], C.ink, [], 3);
    text(pen, `${grid} m`, left + 12, height - bottom - 15);
    const rows = [['path', C.path, []], ['bearings', C.soft, []], ['fence', C.fence, [8, 3, 2, 3]],
      ['target, 2 deviations', C.target, [], dot]];
    if (view.truth && view.truth.length) rows.push(['truth', C.ink, [], cross]);
    legend(pen, rows, left + 8, 34);
  }

  // The bearing from above: ray with one and two deviations, what else it may be, the nose, the belief of the target.
  function polar(canvas, view) {
    const {pen, width, height} = begin(canvas, 0.85);
    const centre = [width / 2, height / 2], radius = Math.min(width, height) / 2 - 22;
    const at = (azimuth, share) => [centre[0] + share * radius * Math.cos(azimuth * RAD),
      centre[1] - share * radius * Math.sin(azimuth * RAD)];
    const wedge = (azimuth, half, share, colour) => { pen.fillStyle = colour; pen.beginPath(); pen.moveTo(...centre);
      for (let k = -20; k <= 20; k += 1) pen.lineTo(...at(azimuth + half * k / 20, share)); pen.closePath(); pen.fill(); };
    pen.strokeStyle = C.soft; pen.beginPath(); pen.arc(...centre, radius, 0, 7); pen.stroke();
    for (let azimuth = 0; azimuth < 360; azimuth += 30) {
      line(pen, [at(azimuth, azimuth % 90 ? 0.96 : 0.92), at(azimuth, 1)], C.soft, [], 1);
      const compass = (450 - azimuth) % 360, name = {0: 'N', 90: 'E', 180: 'S', 270: 'W'}[compass] || `${compass}`;
      const [x, y] = at(azimuth, 1 + 12 / radius);
      text(pen, name, x, y + 4, compass % 90 ? C.soft : C.ink, 'center');
    }
    const bearing = view.bearing;
    if (bearing) {
      if (bearing.azimuth_std_deg !== null) {
        wedge(bearing.azimuth_deg, Math.min(180, 2 * bearing.azimuth_std_deg), 0.95, '#0000001c');
        wedge(bearing.azimuth_deg, Math.min(180, bearing.azimuth_std_deg), 0.95, '#00000030');
      }
      bearing.others.forEach(one => line(pen, [centre, at(one.azimuth_deg, 0.35 + 0.45 * Math.min(1, one.share))], C.soft, [3, 3]));
      line(pen, [centre, at(bearing.azimuth_deg, 0.95)], C.bearing, [], 3);
    }
    const here = view.vehicle && view.vehicle.p_m, target = view.target && view.target.p_m ? view.target : null;
    if (target) {
      const to = p => here ? Math.atan2(p[1] - here[1], p[0] - here[0]) / RAD : target.azimuth_deg;
      target.rivals.forEach(rival => { line(pen, [centre, at(to(rival.p_m), 0.7)], C.target, [2, 4]);
        const [x, y] = at(to(rival.p_m), 0.76); text(pen, `${Math.round(100 * rival.probability)} %`, x, y, C.target, 'center'); });
      pen.fillStyle = C.target;
      dot(pen, ...at(to(target.p_m), 0.86));
    }
    if (view.vehicle && view.vehicle.yaw_deg !== null) {
      pen.fillStyle = C.ink;
      const yaw = view.vehicle.yaw_deg;
      pen.beginPath(); pen.moveTo(...at(yaw, 1)); pen.lineTo(...at(yaw + 3, 1.06)); pen.lineTo(...at(yaw - 3, 1.06)); pen.fill();
    }
    legend(pen, [['bearing', C.bearing, []], ['other paths', C.soft, [3, 3]], ['target', C.target, [], dot],
      ['rivals', C.target, [2, 4]]], 4, 14);
  }

  // The AOA profile: azimuth across, elevation up, on an even scale, with the estimate in it.
  function profile(canvas, picture, bearing) {
    const {pen, width, height} = begin(canvas, 0.6);
    const left = 38, bottom = 40, top = 18, inner = [width - left - 56, height - bottom - top];
    const at = (azimuth, elevation) => [left + (azimuth + 180) / 360 * inner[0], top + (90 - elevation) / 180 * inner[1]];
    if (picture) {
      const small = document.createElement('canvas');
      small.width = picture.columns;
      small.height = picture.rows;
      const brush = small.getContext('2d'), image = brush.createImageData(picture.columns, picture.rows);
      for (let k = 0; k < picture.cells.length; k += 1) {
        const [r, g, b] = C.TABLE[picture.cells[k]];
        image.data.set([r, g, b, 255], 4 * k);
      }
      brush.putImageData(image, 0, 0);
      pen.imageSmoothingEnabled = true;
      pen.drawImage(small, left, top, inner[0], inner[1]);
    } else text(pen, 'no profile yet', left + 10, top + 20, C.soft);
    pen.strokeStyle = C.soft; pen.lineWidth = 1; pen.strokeRect(left, top, inner[0], inner[1]);
    for (let azimuth = -180; azimuth <= 180; azimuth += 90) {
      const [x] = at(azimuth, 0);
      text(pen, `${azimuth}°`, x, height - bottom + 14, C.soft, 'center');
      text(pen, {'-180': 'W', '-90': 'S', 0: 'E', 90: 'N', 180: 'W'}[azimuth], x, top - 5, C.ink, 'center');
    }
    for (let elevation = -90; elevation <= 90; elevation += 45) text(pen, `${elevation}°`, left - 4, at(0, elevation)[1] + 4, C.soft, 'right');
    text(pen, 'azimuth from East, counter-clockwise', left + inner[0] / 2, height - 8, C.soft, 'center');
    if (picture && bearing && bearing.number === picture.number) {
      const [x, y] = at(bearing.azimuth_deg, bearing.elevation_deg === null ? 0 : bearing.elevation_deg);
      pen.lineWidth = 4; pen.strokeStyle = '#fff'; pen.beginPath(); pen.arc(x, y, 9, 0, 7); pen.stroke();
      pen.lineWidth = 2; pen.strokeStyle = '#111'; pen.beginPath(); pen.arc(x, y, 9, 0, 7); pen.stroke();
      if (bearing.elevation_deg === null) line(pen, [[x, top], [x, top + inner[1]]], '#fff', [4, 4]);
    }
    const bar = left + inner[0] + 10;
    for (let k = 0; k < inner[1]; k += 1) { pen.fillStyle = C.css(Math.round(255 * (1 - k / inner[1]))); pen.fillRect(bar, top + k, 10, 1.5); }
    text(pen, '1', bar + 13, top + 9, C.soft);
    text(pen, '0', bar + 13, top + inner[1], C.soft);
    text(pen, 'power', bar - 4, top - 5, C.soft);
  }

  // A line over time, with a mark where the moment is: lines are [name, colour, dash, [[t, y], ...]].
  function chart(canvas, lines, unit, moment) {
    const {pen, width, height} = begin(canvas, 0.42);
    const left = 38, bottom = 24, inner = [width - left - 8, height - bottom - 8];
    const all = lines.flatMap(one => one[3]).filter(p => p[1] !== null);
    if (!all.length) { text(pen, 'nothing to show', left, 20, C.soft); return; }
    const last = Math.max(1, ...all.map(p => p[0])), high = 1.1 * Math.max(1e-9, ...all.map(p => p[1]));
    const at = ([t, y]) => [left + t / last * inner[0], 8 + (1 - y / high) * inner[1]];
    const rise = step(high, 4), run = step(last, 6);
    for (let y = 0; y <= high; y += rise) { line(pen, [at([0, y]), at([last, y])], C.faint, [], 1); text(pen, `${+y.toFixed(2)}`, left - 4, at([0, y])[1] + 4, C.soft, 'right'); }
    for (let t = 0; t <= last; t += run) text(pen, `${t}`, at([t, 0])[0], height - 8, C.soft, 'center');
    lines.forEach(([, colour, dash, points]) => {
      let part = [];
      points.concat([[0, null]]).forEach(p => { if (p[1] === null) { if (part.length) line(pen, part, colour, dash); part = []; } else part.push(at(p)); });
    });
    if (moment !== null) line(pen, [at([moment, 0]), at([moment, high])], C.ink, [2, 2], 1);
    text(pen, `[${unit}]`, left + 4, 18, C.soft);
    text(pen, 'time [s]', width - 8, height - 8, C.soft, 'right');
    legend(pen, lines.map(([name, colour, dash]) => [name, colour, dash]), left + 50, 18);
  }

  return {map, polar, profile, chart};
})();
