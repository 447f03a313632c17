// The command of surfel-render that makes the picture that is seen.

import { shortNumber } from 'surfel/camera.js';

const numbers = (values) => values.map(shortNumber).join(',');

/** The part of a scene that a clip plane leaves, as --bounds takes it. */
function boundsOf(clip, box) {
  const far = Math.hypot(...box.max.map((value, i) => value - box.min[i])) || 1;
  const end = (value, i, sign) => (Number.isFinite(value) ? value : box[sign < 0 ? 'min' : 'max'][i] + sign * far);
  return [...clip.min.map((value, i) => end(value, i, -1)), ...clip.max.map((value, i) => end(value, i, 1))];
}

/**
 * @param info  what the page says of the file.
 * @param view  camera, size, mode, lit, backgroundCode, clip, lodError.
 */
export function commandFor(info, view) {
  const { camera } = view;
  const words = [
    'surfel-render', info.path, '-o', view.mode === 'depth' ? 'view.exr' : 'view.png',
    `--size ${view.size[0]}x${view.size[1]}`, `--eye=${numbers(camera.eye)}`,
    `--target=${numbers(camera.target)}`, `--up=${numbers(camera.up)}`,
    camera.ortho > 0 ? `--ortho ${shortNumber(camera.ortho)}` : `--fov ${shortNumber(camera.fov)}`, `--shading ${view.lit ? 'phong' : 'none'}`,
    '--relief none', `--background '${view.backgroundCode}'`,
  ];
  if (view.mode === 'normal') words.push('--color-by normal');
  if (view.mode === 'attribute') {
    words.push(`--color-by ${info.attributeWord} --color-map viridis`, `--color-range=${numbers(info.range)} --legend off`);
  }
  if ((view.mode === 'color' || view.mode === 'depth') && !info.colored) words.push('--color-by none');
  if (view.clip) words.push(`--bounds=${numbers(boundsOf(view.clip, info))}`);
  if (info.levels > 1 && view.lodError !== 1.4) words.push(`--lod-error ${shortNumber(view.lodError)}`);
  return words.join(' ');
}
