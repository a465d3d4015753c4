'use strict';
// The pictures' colours. The scale of the heat map rises evenly in lightness from dark blue to yellow, so that it reads
// the same in grey and to most who see few colours; everything else is told apart by its form first.
const Colours = (() => {
  // Anchors of the scale in CIE L*a*b* (lightness, then along blue to yellow), spaced evenly in lightness.
  const ANCHORS = [[12, 8, -38], [27, 5, -30], [42, 1, -12], [57, -2, 6], [72, -3, 30], [87, -4, 55], [94, -6, 66]];

  function toRgb([L, a, b]) {
    const y = (L + 16) / 116, inverse = t => t > 6 / 29 ? t ** 3 : 3 * (6 / 29) ** 2 * (t - 4 / 29);
    const X = 0.9505 * inverse(y + a / 500), Y = inverse(y), Z = 1.089 * inverse(y - b / 200);
    const linear = [3.2406 * X - 1.5372 * Y - 0.4986 * Z, -0.9689 * X + 1.8758 * Y + 0.0415 * Z,
      0.0557 * X - 0.204 * Y + 1.057 * Z];
    return linear.map(c => {
      const one = Math.min(1, Math.max(0, c));
      return Math.round(255 * (one <= 0.0031308 ? 12.92 * one : 1.055 * one ** (1 / 2.4) - 0.055));
    });
  }

  function scale(share) {
    const lightness = ANCHORS[0][0] + share * (ANCHORS[ANCHORS.length - 1][0] - ANCHORS[0][0]);
    let k = 0;
    while (k < ANCHORS.length - 2 && ANCHORS[k + 1][0] < lightness) k += 1;
    const [from, to] = [ANCHORS[k], ANCHORS[k + 1]], part = (lightness - from[0]) / (to[0] - from[0]);
    return toRgb([lightness, from[1] + part * (to[1] - from[1]), from[2] + part * (to[2] - from[2])]);
  }

  const TABLE = Array.from({length: 256}, (_, k) => scale(k / 255));
  return {TABLE, ink: '#111', soft: '#666', faint: '#ddd', path: '#26456e', bearing: '#111', target: '#a40000',
    fence: '#666', css: k => `rgb(${TABLE[k].join(',')})`};
})();
