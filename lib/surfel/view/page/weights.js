// What follows from the cutoff of the kernels and the pixel filter, as in surfel-render.

export class Weights {
  constructor(cutoff, lowpass) {
    const lost = Math.exp(-cutoff);
    this.mean = 1 - lost;
    this.full = coverageThreshold(cutoff);
    this.edge = this.mean - (this.mean - this.full) / 4;
    this.reach = Math.min(8, Math.ceil(3 * lowpass));
    const deviation = Math.min(1, lowpass);
    const taps = [0, 1, 2].map((i) => Math.exp(-((i / deviation) ** 2) / 2));
    const sum = taps[0] + 2 * (taps[1] + taps[2]);
    this.taps = taps.map((tap) => tap / sum);
    const variance = 2 * (this.taps[1] + 4 * this.taps[2]);
    const ofKernel = 1 - (cutoff * lost) / (1 - lost);
    const k2 = ofKernel + variance / (lowpass * lowpass);
    this.backward = ((k2 - 1) / 2) * lowpass * lowpass;
    this.sharpen = sharpeningTable(Math.sqrt(k2));
  }
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

/** The normal distribution: Abramowitz, Stegun, 7.1.26 would be too coarse, so this is a series. */
function normalDistribution(z) {
  if (z < -6) return 0;
  if (z > 6) return 1;
  let term = z;
  let sum = z;
  for (let i = 1; Math.abs(term) > 1e-12; ++i) {
    term *= (z * z) / (2 * i + 1);
    sum += term;
  }
  return 0.5 + (sum * Math.exp((-z * z) / 2)) / Math.sqrt(2 * Math.PI);
}

/** Phi(k Phi^-1(i / 512)). */
function sharpeningTable(k) {
  const table = new Float32Array(513);
  const steps = 4096;
  let before = 0;
  let sharpBefore = 0;
  let next = 0;
  for (let step = 0; step <= steps; ++step) {
    const z = 6 * ((2 * step) / steps - 1);
    const here = step === steps ? 1 : normalDistribution(z);
    const sharp = step === steps ? 1 : normalDistribution(k * z);
    for (; next <= 512 && next <= here * 512; ++next) {
      const share = here > before ? (next / 512 - before) / (here - before) : 0;
      table[next] = sharpBefore + share * (sharp - sharpBefore);
    }
    before = here;
    sharpBefore = sharp;
  }
  return table;
}
