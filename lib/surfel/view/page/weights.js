// What follows from the cutoff of the kernels and the pixel filter, as in surfel-render.

export class Weights {
  constructor(cutoff, lowpass) {
    const lost = Math.exp(-cutoff);
    this.mean = 1 - lost;
    this.full = coverageThreshold(cutoff);
    this.edge = this.mean - (this.mean - this.full) / 4;
    this.reach = Math.min(8, Math.ceil(3 * lowpass));
    const even = gaussian(Math.min(1, lowpass) ** 2);
    this.taps = even;
    const filter = lowpass * lowpass;
    const lacking = (cutoff * lost) / (1 - lost);
    // Taps by distance, and sharpening; by step of the spacing.
    this.completing = new Float32Array(32);
    for (let step = 0; step < 8; ++step) {
      const share = Math.min(1, step / 2.5);
      const taps = ofVariance(lacking * filter + share * Math.max(0, varianceOf(even) - lacking * filter));
      const k = Math.sqrt(Math.max(1, 1 - lacking + varianceOf(taps) / filter));
      this.completing.set([...taps, k - 1], 4 * step);
    }
  }
}

/** EdgeFilter's taps. */
function gaussian(variance) {
  const taps = [0, 1, 2].map((i) => Math.exp((-i * i) / (2 * variance)));
  const sum = taps[0] + 2 * (taps[1] + taps[2]);
  return taps.map((tap) => tap / sum);
}
const varianceOf = (taps) => 2 * (taps[1] + 4 * taps[2]);
function ofVariance(variance) {
  if (variance < 0.4) return [1 - variance, variance / 2, 0];
  let low = 0;
  let high = 16;
  for (let i = 0; i < 60; ++i) {
    const middle = (low + high) / 2;
    if (varianceOf(gaussian(middle)) < variance) low = middle;
    else high = middle;
  }
  return gaussian(high);
}

/** The least sum of kernels inside of a surface. */
function coverageThreshold(cutoff) {
  const measured = [[0, 0], [0.5, 0.1], [1, 0.31], [1.5, 0.51], [2, 0.61], [3, 0.74], [4, 0.775], [16, 0.795]];
  for (let i = 1; i < measured.length; ++i) {
    const [c0, t0] = measured[i - 1];
    const [c1, t1] = measured[i];
    if (cutoff <= c1) return t0 + ((t1 - t0) * (cutoff - c0)) / (c1 - c0);
  }
  return measured[measured.length - 1][1];
}
