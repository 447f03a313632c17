// The programs of the graphics processor. Names and equations are those of surfel-render: Zwicker,
// Pfister, van Baar, Gross, "Surface Splatting", 2001 (SS01). Row 0 of every texture is the top row
// of the picture, so that gl_FragCoord is a place in the picture.

export const kHead = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
`;

/** Phi, the normal distribution's cumulative function, and where what half-planes leave is all or nothing. */
const kPhi = `
const float kLeastShare = 1e-3;
const float kWhole = 4.0;
float normal_cdf(float z) {
  float x = clamp(z, -4.0, 4.0);
  float y = x * x;
  float p = 9.26824375e-11;
  p = p * y - 7.83297548e-9;
  p = p * y + 2.95175639e-7;
  p = p * y - 6.65088957e-6;
  p = p * y + 0.000101978877;
  p = p * y - 0.00114901053;
  p = p * y + 0.00991699387;
  p = p * y - 0.0664573931;
  p = p * y + 0.398939041;
  return p * x + 0.5;
}
`;

/**
 * What surfels are to the screen: a quad around each one's kernel, or a point as large.
 * @param attributes  whether colours and normals are wanted.
 * @param clips       whether half-planes may cut surfels.
 */
export const splatVertex = (attributes, clips) => `${kHead}
#define ATTRIBUTES ${attributes ? 1 : 0}
#define CLIPS ${clips ? 1 : 0}
layout(location = 0) in uvec2 a_cluster;  // Slot, and how many of its surfels are drawn.

uniform usampler2D u_list;  // The same of all clusters, for points.
uniform int u_most;         // Most surfels of a cluster.

uniform usampler2D u_first, u_second, u_shading;
uniform sampler2D u_table;
uniform mat3 u_rotation;  // Into camera space; its columns are the matrix's columns.
uniform vec3 u_translation;
uniform vec2 u_focal, u_center, u_size;
uniform float u_two_c, u_lowpass2, u_tolerance;
uniform float u_covering;  // Variance that a merged surfel has at least, by its area.
uniform float u_growth;    // Surfels that each drawn one stands for.
uniform int u_mode;        // 0 colour, 1 normals, 2 depth, 3 attribute.
uniform bool u_mapped;     // There are normals to shade with.
uniform vec3 u_clip_min, u_clip_max;  // Centres beyond are left out.
uniform sampler2D u_map;   // Colours of attributes, linear.
uniform bool u_points;
uniform bool u_ortho;
uniform float u_far;       // Of orthographic views: behind all surfels. Depths are u_far - z there, 1 / z elsewhere.

flat out vec4 v_place;  // Centre, pixels; amplitude; flags.
flat out vec4 v_a, v_b, v_c;
flat out vec3 v_more;  // Variance of the pixel filter of exact kernels; alpha; steps of the spacing.
// kSpacingStep: by the mean variance of a splat without the pixel filter, over the filter's; not rounded yet.
float spacing_steps(float variance) { return min(7.0, sqrt(max(0.0, variance)) * 7.0 / 3.0); }
#if CLIPS
uniform usampler2D u_clips;
uniform float u_beyond_growth;
// SplatClip: of both half-planes the argument of Phi at the centre, and what it gains with a pixel; of exact kernels the
// distance and the weighed direction. Then the joint share, and what counts beyond.
flat out vec4 v_line1, v_line2;
flat out vec4 v_outward;
#endif
#if ATTRIBUTES
flat out vec4 v_color;  // Times alpha.
flat out vec3 v_normal;
#endif

const float kPi = 3.14159265358979;

vec3 direction(uint code) {
  if (code == 0xffffffffu) return vec3(0);
  vec2 e = vec2(code & 0xffffu, code >> 16) * (2.0 / 65534.0) - 1.0;
  vec3 d = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  float folded = max(-d.z, 0.0);
  d.x += d.x < 0.0 ? folded : -folded;
  d.y += d.y < 0.0 ? folded : -folded;
  return normalize(d);
}

vec3 any_tangent(vec3 n) {
  float s = n.z < 0.0 ? -1.0 : 1.0;
  float a = -1.0 / (s + n.z);
  return vec3(1.0 + s * n.x * n.x * a, s * n.x * n.y * a, -s * n.x);
}

vec3 linear_of(vec3 code) {
  return mix(code / 12.92, pow((code + 0.055) / 1.055, vec3(2.4)), step(0.04045, code));
}

#if CLIPS
${kPhi}
// A half-plane: half_plane_cuts-inl.h and clip_kernel.h of surfel-render have the functions below.
struct Line { bool cuts; vec3 direction; float distance; vec2 w, across, outward; float inv_s; };

// weight_of_correlation()
float weight_of_correlation(float r) { return 2.0 / kPi * asin(clamp(r, -1.0, 1.0)); }

// outward_on_screen()
vec2 outward_of(Line l, vec3 n, vec3 p) {
  vec3 along = cross(n, l.direction);
  vec3 plane = u_ortho ? vec3(along.y, -along.x, 0) : cross(along, p + l.distance * l.direction);
  vec2 outward = plane.xy / u_focal;
  float size = length(outward);
  if (!(size > 0.0)) return vec2(0);
  return outward * ((dot(plane, l.direction) < 0.0 ? -1.0 : 1.0) / size);
}

// make_exact_clip()
void put_exact_lines(Line lines[2]) {
  int first = lines[0].cuts ? 0 : 1;
  v_line1.xyz = vec3(lines[first].distance, lines[first].w);
  v_outward.xy = lines[first].outward;
  if (!lines[0].cuts || !lines[1].cuts) return;
  v_line2.xyz = vec3(lines[1].distance, lines[1].w);
  v_outward.zw = lines[1].outward;
  v_line1.w = weight_of_correlation(dot(lines[0].outward, lines[1].outward));
}

// cuts(); false where nothing is left.
bool put_lines(Line lines[2], vec2 t, vec2 b, float det_A) {
  float size2 = dot(t, t) + dot(b, b);
  float h2 = max(u_lowpass2, 1e-8 * size2);
  float inv_det = 1.0 / (det_A * det_A + h2 * (size2 + h2));
  vec3 arguments[2];
  float beyond = 1.0;
  for (int j = 0; j < 2; ++j) {
    if (!lines[j].cuts) continue;
    vec2 w = lines[j].w;
    vec2 across = w.x * b - w.y * t;
    float all = dot(w, w);
    float variance = h2 * inv_det * (h2 * all + dot(across, across));
    float inv_s = inversesqrt(variance);
    float z = lines[j].distance * inv_s;
    vec2 a = w.x * t + w.y * b;
    arguments[j] = vec3(z, -inv_det * inv_s * (h2 * a + det_A * vec2(across.y, -across.x)));
    float reach = inv_s * sqrt(u_two_c * max(0.0, all - variance));
    lines[j].cuts = z - reach < 3.1;
    if (lines[j].cuts && z + reach < -3.1) return false;
    lines[j].across = across;
    lines[j].inv_s = inv_s;
    if (!lines[j].cuts) continue;
    float q = variance / all;
    beyond = max(beyond, 1.0 + q * q * (u_beyond_growth + 1.4 * q * q * q * q * q * q));
  }
  if (!lines[0].cuts && !lines[1].cuts) return true;
  int first = lines[0].cuts ? 0 : 1;
  v_line1.xyz = arguments[first];
  v_outward.xy = lines[first].outward;
  v_line2.w = beyond;
  if (!lines[0].cuts || !lines[1].cuts) return true;
  v_line2.xyz = arguments[1];
  v_outward.zw = lines[1].outward;
  float covariance = h2 * inv_det * (h2 * dot(lines[0].w, lines[1].w) + dot(lines[0].across, lines[1].across));
  v_line1.w = weight_of_correlation(covariance * lines[0].inv_s * lines[1].inv_s);
  return true;
}
#endif

void main() {
  gl_Position = vec4(2, 2, 2, 1);
  gl_PointSize = 0.0;
  uint surfel = uint(gl_VertexID) >> 2;
  uvec2 cluster = a_cluster;
  if (u_points) {
    int place = gl_VertexID / u_most;
    surfel = uint(gl_VertexID - place * u_most);
    cluster = texelFetch(u_list, ivec2(place & 2047, place >> 11), 0).xy;
  }
  if (surfel >= cluster.y) return;
  uint slot = cluster.x;
  ivec2 at = ivec2(int((slot & 15u) * 256u + surfel), int(slot >> 4));
  ivec2 row = ivec2(int((slot & 1023u) * 4u), int(slot >> 10));
  vec4 t0 = texelFetch(u_table, row, 0);
  vec4 t1 = texelFetch(u_table, row + ivec2(1, 0), 0);
  vec4 t2 = texelFetch(u_table, row + ivec2(2, 0), 0);
  vec4 t3 = texelFetch(u_table, row + ivec2(3, 0), 0);
  uvec4 first = texelFetch(u_first, at, 0);
  uvec2 second = texelFetch(u_second, at, 0).xy;
  vec3 world = t0.xyz + t1.xyz * vec3(first.x & 0xffffu, first.x >> 16, first.y & 0xffffu);
  if (any(lessThan(world, u_clip_min)) || any(greaterThan(world, u_clip_max))) return;
  float area = exp2(t2.x + t2.y * float(second.x & 0xffffu)) * u_growth;
  float least = t3.x > 0.0 ? sqrt(u_covering * area) : 0.0;
  float grown = sqrt(u_growth);
  float stored_u = exp2(t0.w + t1.w * float(first.y >> 16));
  float stored_v = exp2(t0.w + t1.w * float(second.x >> 16));
  float s_u = max(stored_u * grown, least);
  float s_v = max(stored_v * grown, least);

  vec3 p = u_rotation * world + u_translation;
  vec3 world_normal = direction(first.z);
  float distance = u_ortho ? 1.0 : length(p);
  bool known = world_normal != vec3(0);
  vec3 n = known ? u_rotation * world_normal : u_ortho ? vec3(0, 0, -1) : -p / distance;
  float angle = float(second.y & 0xffffu) * (kPi / 65536.0);
  vec3 t;
  if (known) {
    vec3 a = any_tangent(world_normal);
    t = u_rotation * (cos(angle) * a + sin(angle) * cross(world_normal, a));
  } else {
    t = any_tangent(n);
  }
  vec3 b = cross(n, t);

  // Columns of J V^(1/2), and Sigma = J V J^T + h^2 I: SS01 (6).
  float inv_z = u_ortho ? 1.0 : 1.0 / p.z;
  vec2 slope = u_ortho ? vec2(0) : p.xy * inv_z;
  vec2 center = u_focal * (u_ortho ? p.xy : slope) + u_center;
  vec2 per_unit = u_focal * inv_z;
  vec2 Jt = per_unit * s_u * (t.xy - slope * t.z);
  vec2 Jb = per_unit * s_v * (b.xy - slope * b.z);
  float deviation = max(s_u, s_v);
  float share = 1.0;
  float stretch = 1.0;
  vec2 moved = vec2(0);
#if CLIPS
  Line lines[2];
  vec2 whole_t = Jt;
  vec2 whole_b = Jb;
  {
    uvec2 codes = texelFetch(u_clips, at, 0).xy;
    vec3 a = known ? any_tangent(world_normal) : vec3(0);
    vec3 across = cross(world_normal, a);
    for (int j = 0; j < 2; ++j) {
      uint code = j == 0 ? codes.x : codes.y;
      Line l;
      l.cuts = known && code >> 16 != 0xffffu;
      float turn = float(code & 0xffffu) * (2.0 * kPi / 65536.0);
      l.direction = u_rotation * (cos(turn) * a + sin(turn) * across);
      l.distance = (float(code >> 16) / 32767.0 - 1.0) * 8.0 * max(stored_u, stored_v);
      l.w = vec2(dot(l.direction, t) * s_u, dot(l.direction, b) * s_v);
      lines[j] = l;
    }
    // Cut Gaussians that are smaller than the pixel filter are taken for whole ones with their volume, mean and variance:
    // cut_filtered().
    float seen = max(u_focal.x, u_focal.y) * inv_z * deviation;
    if (seen * seen < u_lowpass2 && (lines[0].cuts || lines[1].cuts)) {
      vec2 mean = vec2(0);
      float uu = 1.0;
      float uv = 0.0;
      float vv = 1.0;
      float det = 1.0;
      for (int j = 0; j < 2; ++j) {
        if (!lines[j].cuts) continue;
        lines[j].cuts = false;
        vec2 w = lines[j].w;
        vec2 c = vec2(uu * w.x + uv * w.y, uv * w.x + vv * w.y);
        float inv_s = inversesqrt(dot(w, c));
        float alpha = (lines[j].distance - dot(w, mean)) * inv_s;
        if (!(alpha < 3.1)) continue;
        if (alpha < -3.1) return;
        float left = max(normal_cdf(alpha), kLeastShare);
        float lambda = 0.398942280401 * exp(-0.5 * alpha * alpha) / left;
        float lost = min(lambda * (lambda + alpha), 0.99);
        vec2 e = c * inv_s;
        share *= left;
        mean -= lambda * e;
        uu -= lost * e.x * e.x;
        uv -= lost * e.x * e.y;
        vv -= lost * e.y * e.y;
        det -= lost * det;
      }
      if (share < kLeastShare) return;
      float l_uu = sqrt(uu);
      float l_vv = sqrt(det) / l_uu;
      moved = mean.x * Jt + mean.y * Jb;
      Jt = l_uu * Jt + uv / l_uu * Jb;
      Jb = l_vv * Jb;
      stretch = l_uu * l_vv;
    }
  }
#endif
  float xx = Jt.x * Jt.x + Jb.x * Jb.x;
  float yy = Jt.y * Jt.y + Jb.y * Jb.y;
  float h2 = u_lowpass2;
  vec3 Sigma = vec3(xx + h2, Jt.x * Jt.y + Jb.x * Jb.y, yy + h2);
  float n_ray = dot(n, vec3(slope, 1));
  float det_J = per_unit.x * per_unit.y * abs(n_ray);
  float det_JV = det_J * s_u * s_v * stretch;
#if CLIPS
  float det_A = per_unit.x * per_unit.y * n_ray * s_u * s_v;
#endif
  float det = det_JV * det_JV + h2 * (xx + yy + h2);

  float n_p = u_ortho ? n.z : dot(n, p);
  float cosine = abs(n_p) / distance;
  float inv_cosine = 1.0 / max(cosine, 0.1);
  float pixel = sqrt(h2) / min(u_focal.x, u_focal.y);
  float radius = sqrt(u_two_c) * deviation;

  // Where the affine approximation (4) may be off by more than the tolerance, every pixel's ray
  // meets the plane by itself.
  float size2 = u_two_c * (xx + yy);
  float depth_extent = radius * sqrt(max(0.0, 1.0 - n.z * n.z));
  bool in_front = p.z - depth_extent > 0.0;
  if (u_ortho && !in_front) return;
#if CLIPS
  v_line1 = vec4(1e18, 0, 0, 0);
  v_line2 = vec4(1e18, 0, 0, 1);
  v_outward = vec4(0);
#endif
  bool exact = !u_ortho && !(in_front && sqrt(size2) * depth_extent <= u_tolerance * (p.z - depth_extent));

  float alpha = float(first.w >> 24) / 255.0;
  float front = n_p < 0.0 ? 1.0 : 0.0;
  float grazing = inv_cosine > 4.0 ? 4.0 : 0.0;
  float filter_reach = sqrt(u_two_c * h2);
  vec2 lo, hi;
  if (!exact) {
    vec2 reach = sqrt(u_two_c * Sigma.xz);
    lo = center - reach;
    hi = center + reach;
    float diagonal2 = dot(reach, reach);
    float flags = front + grazing;
    float amplitude = area / (2.0 * kPi) * det_J * inversesqrt(det) * share;
    if (!(amplitude > 1e-15)) return;
    float inv_np = 1.0 / (n_p < 0.0 ? min(n_p, -1e-3 * distance) : max(n_p, 1e-3 * distance));
    float on_plane = pixel * (u_ortho ? 1.0 : p.z) * inv_cosine;
    float footprint = sqrt(u_two_c * (deviation * deviation + on_plane * on_plane));
    v_place = vec4(center + moved, amplitude, flags);
    v_a = vec4(Sigma.y / Sigma.z, 0.5 * Sigma.z / det, 0.5 / Sigma.z, footprint * inv_z * inv_z);
    v_b = vec4(u_ortho ? u_far - p.z : inv_z, n.xy * inv_np / u_focal, 0);
    v_b.x += dot(v_b.yz, moved);
    v_c = vec4(0);
    v_more = vec3(0, alpha, spacing_steps(diagonal2 / (2.0 * u_two_c * h2) - 1.0));
    lo += moved;
    hi += moved;
  } else {
    if (!(cosine > 1e-6)) return;
    // Bounds of the disc's projection: the lines through the eye that touch it (Sigg et al. 2006).
    vec3 du = sqrt(u_two_c) * s_u * t;
    vec3 dv = sqrt(u_two_c) * s_v * b;
    float reach_z = sqrt(du.z * du.z + dv.z * dv.z);
    float farthest = p.z + reach_z;
    if (!(farthest > 0.0)) return;
    float nearest = max(p.z - reach_z, 1e-4 * radius);
    lo = vec2(0);
    hi = u_size;
    if (p.z - reach_z > 1e-3 * radius) {
      float ww = du.z * du.z + dv.z * dv.z - p.z * p.z;
      vec2 xw = du.xy * du.z + dv.xy * dv.z - p.xy * p.z;
      vec2 x2 = du.xy * du.xy + dv.xy * dv.xy - p.xy * p.xy;
      vec2 root = sqrt(max(vec2(0), xw * xw - ww * x2));
      vec2 e0 = u_focal * (xw - root) / ww + u_center;
      vec2 e1 = u_focal * (xw + root) / ww + u_center;
      lo = min(e0, e1) - filter_reach;
      hi = max(e0, e1) + filter_reach;
    }
    vec2 half_box = 0.5 * (hi - lo) - filter_reach;
    float disc2 = dot(half_box, half_box);
    float flags = front + 32.0 + (cosine < 0.25 ? 4.0 : 0.0);
    float amplitude = area / (2.0 * kPi * s_u * s_v);
    if (!(amplitude > 1e-15)) return;
    vec2 middle = 0.5 * (max(lo, vec2(0)) + min(hi, u_size));
    vec3 ray = vec3((middle - u_center) / u_focal, 1);
    vec3 du_line = (t - n * (dot(t, p) / n_p)) / s_u;
    vec3 dv_line = (b - n * (dot(b, p) / n_p)) / s_v;
    vec3 plane = n / n_p;
    float on_pixel = filter_reach / min(u_focal.x, u_focal.y) * inv_cosine;
    v_place = vec4(middle, amplitude, flags);
    v_a = vec4(dot(du_line, ray), du_line.xy / u_focal, 1.0 / (farthest * (1.0 + on_pixel)));
    v_b = vec4(dot(dv_line, ray), dv_line.xy / u_focal, (1.0 + on_pixel) / nearest);
    v_c = vec4(dot(plane, ray), plane.xy / u_focal, u_two_c * deviation * deviation);
    v_more = vec3(on_pixel * on_pixel, alpha, spacing_steps(disc2 / (2.0 * filter_reach * filter_reach)));
  }
#if CLIPS
  if (lines[0].cuts || lines[1].cuts) {
    for (int j = 0; j < 2; ++j) {
      if (lines[j].cuts) lines[j].outward = outward_of(lines[j], n, p);
    }
    if (exact) {
      put_exact_lines(lines);
    } else if (!put_lines(lines, whole_t, whole_b, det_A)) {
      return;
    }
  }
#endif

#if ATTRIBUTES
  vec3 code = vec3(first.w & 255u, first.w >> 8 & 255u, first.w >> 16 & 255u) / 255.0;
  vec3 color = t2.z + t2.w * linear_of(code);
  vec3 shown = u_mapped ? direction(texelFetch(u_shading, at, 0).x) : world_normal;
  if (u_mode == 1) color = known ? linear_of(0.5 * world_normal + 0.5) : linear_of(vec3(0.25));
  if (u_mode == 3) {
    float share = float(second.y >> 16 & 255u) / 255.0;
    color = texelFetch(u_map, ivec2(int(share * 255.0 + 0.5), 0), 0).rgb;
  }
  v_color = vec4(color * alpha, alpha);
  v_normal = shown;
#endif

  // Fragments are the pixels whose centres lie in the box.
  lo = clamp(lo, vec2(-2), u_size + 2.0);
  hi = clamp(hi, vec2(-2), u_size + 2.0);
  if (u_points) {
    lo = max(lo, vec2(0));
    hi = min(hi, u_size);
    if (any(lessThanEqual(hi, lo))) return;
    gl_PointSize = max(hi.x - lo.x, hi.y - lo.y);
    gl_Position = vec4((lo + hi) / u_size - 1.0, 0, 1);
    return;
  }
  vec2 corner = vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1);
  gl_Position = vec4(mix(lo, hi, corner) / u_size * 2.0 - 1.0, 0, 1);
}
`;

const sampleOf = (clips) => `
#define CLIPS ${clips ? 1 : 0}
flat in vec4 v_place, v_a, v_b, v_c;
flat in vec3 v_more;
uniform float u_cutoff, u_epsilon, u_lowpass2;

struct Sample { float beta, depth, epsilon, amplitude, center; };

#if CLIPS
${kPhi}
flat in vec4 v_line1, v_line2, v_outward;
uniform float u_least_clip;
vec2 arguments = vec2(kWhole);  // Of Phi.
bool has_two_lines() { return v_line2.x < 1e17; }

float share_of(float z) { return z >= kWhole ? 1.0 : normal_cdf(z); }
vec3 shares() {  // Of both lines together, and of each.
  vec3 s = vec3(0, share_of(arguments.x), share_of(arguments.y));
  float both = s.y * s.z;
  float bound = v_line1.w > 0.0 ? min(s.y, s.z) : max(0.0, s.y + s.z - 1.0);
  s.x = both + abs(v_line1.w) * (bound - both);
  return s;
}
float left() { return v_line1.x < 1e17 ? shares().x : 1.0; }
#else
float left() { return 1.0; }
#endif

Sample splat() {
  vec2 d = gl_FragCoord.xy - v_place.xy;
  Sample s;
  if ((int(v_place.w) & 32) == 0) {
    float e = d.x - v_a.x * d.y;
    s.beta = v_a.y * e * e + v_a.z * d.y * d.y;
    s.depth = v_b.x + clamp(dot(v_b.yz, d), -v_a.w, v_a.w);
    s.epsilon = v_a.w * u_epsilon;
    s.amplitude = v_place.z;
    s.center = v_b.x;
#if CLIPS
    arguments.x = v_line1.x + dot(v_line1.yz, d);
    arguments.y = v_line2.x + dot(v_line2.yz, d);
    if (min(arguments.x, arguments.y) < u_least_clip) s.beta = 1e30;
#endif
    return s;
  }
  // SS01 (8): the projection is linearised where the pixel's ray meets the plane.
  vec3 at = vec3(1, d);
  float plane = dot(v_c.xyz, at);
  float z = 1.0 / plane;
  float u = dot(v_a.xyz, at) * z;
  float v = dot(v_b.xyz, at) * z;
  vec2 du = v_a.yz - u * v_c.yz;
  vec2 dv = v_b.yz - v * v_c.yz;
  float filtered = u_lowpass2 * z * z;
  float crossed = filtered * (du.x * dv.y - du.y * dv.x);
  float det = crossed * crossed + filtered * (dot(du, du) + dot(dv, dv)) + 1.0;
  vec2 skew = u * dv - v * du;
  s.beta = plane > 0.0 ? 0.5 / det * (filtered * dot(skew, skew) + u * u + v * v) : 1e30;
  s.depth = clamp(plane, v_a.w, v_b.w);
  s.epsilon = u_epsilon * s.depth * sqrt(v_c.w * s.depth * s.depth + v_more.x);
  s.amplitude = v_place.z * inversesqrt(det);
  s.center = 2.0 / (1.0 / v_a.w + 1.0 / v_b.w);
#if CLIPS
  for (int j = 0; j < 2; ++j) {
    vec3 line = j == 0 ? v_line1.xyz : v_line2.xyz;
    if (line.x > 1e17) continue;
    vec2 w = line.yz;
    vec2 bend = w.x * dv - w.y * du;
    float mean = filtered * dot(bend, skew) + dot(w, vec2(u, v));
    vec2 c = w.x * du + w.y * dv;
    float s2 = filtered * dot(c, c) + crossed * crossed * dot(w, w);
    float deviation = sqrt(max(s2, 1e-8 * dot(w, w) * det) * det);
    arguments[j] = (line.x * det - mean) / max(deviation, 1e-30);
  }
  if (min(arguments.x, arguments.y) < u_least_clip) s.beta = 1e30;
#endif
  return s;
}
`;

/**
 * The layers of a pixel: surfaces, each with the nearest fragment, and sums over the fragments within the depth range
 * of it. Others join a layer where they lie within their depth range of its mean depth.
 */
const kLayers = `
uniform sampler2D u_nearest1, u_nearest2, u_nearest3, u_nearest4;
uniform sampler2D u_means1, u_means2, u_means3, u_means4;
uniform float u_edge_weight;
uniform bool u_opaque;
#if CLIPS
uniform sampler2D u_away1, u_away2, u_away3, u_away4;  // What lines cut off.
#else
#define u_away1 u_means1
#define u_away2 u_means2
#define u_away3 u_means3
#define u_away4 u_means4
#endif

struct Found { float depth, weight, away; int flags; };

// A layer that has not been summed up yet has its nearest fragment's depth.
Found found(sampler2D nearest, sampler2D means, sampler2D away) {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec2 first = texelFetch(nearest, at, 0).xy;
  vec3 sums = texelFetch(means, at, 0).xyz;
  Found f;
  f.depth = sums.x > 0.0 ? first.x * (1.0 - sums.y / sums.x) : first.x;
  f.weight = sums.x;
#if CLIPS
  f.away = texelFetch(away, at, 0).x;
#else
  f.away = 0.0;
#endif
  f.flags = int(first.y);
  return f;
}
bool joins(Found f, Sample s) { return ((f.flags ^ int(v_place.w)) & 1) == 0 && s.depth + s.epsilon >= f.depth; }
// A front that covers the pixel hides the backs behind it.
bool hides(Found f, Sample s) {
  return u_opaque && (f.flags & 1) != 0 && (int(v_place.w) & 1) == 0 && f.weight >= u_edge_weight &&
         f.away <= 1e-3 * f.weight && s.depth < f.depth;
}
`;

/** Fragments of surfaces that none of the layers before holds or hides. */
const kBehind = `
uniform int u_layer;  // Layers before.
bool keeps(sampler2D nearest, sampler2D means, sampler2D away, Sample s) {
  Found f = found(nearest, means, away);
  return f.flags == 0 || joins(f, s) || hides(f, s);
}
bool is_behind(Sample s) {
  if (u_layer > 0 && keeps(u_nearest1, u_means1, u_away1, s)) return false;
  if (u_layer > 1 && keeps(u_nearest2, u_means2, u_away2, s)) return false;
  return u_layer < 3 || !keeps(u_nearest3, u_means3, u_away3, s);
}
`;

/**
 * The visibility pass: the nearest fragment's depth, the flags of its splat, its depth range, and its DepthSlope, as
 * two numbers of 12 bits that tell logarithms of the depth's relative change from pixel to pixel.
 */
export const nearestFragment = (clips) => `${kHead}${sampleOf(clips)}${kLayers}${kBehind}
uniform float u_depth_scale;
layout(location = 0) out vec4 nearest;
float slope_code(float change) { return clamp(floor(2048.5 + sign(change) * 100.0 * log2(1.0 + 1e5 * abs(change))), 0.0, 4095.0); }
void main() {
  Sample s = splat();
  if (!(s.beta < u_cutoff)) discard;
  if (!is_behind(s)) discard;
  gl_FragDepth = clamp(s.depth * u_depth_scale, 0.0, 1.0);
  vec2 slope = ((int(v_place.w) & 32) == 0 ? v_b.yz : v_c.yz) / s.depth;
  nearest = vec4(s.depth, v_place.w + 64.0, s.epsilon, 4096.0 * slope_code(slope.x) + slope_code(slope.y));
}
`;

/**
 * Sums over the fragments around the nearest one: rho, and rho times the relative distance from it. Of opaque clouds
 * also what tells the spacing of splats: surfel-render has the step of the splat that comes first, by its centre, which
 * outweighs all others here. Of other clouds rho times alpha.
 */
export const meanFragment = (clips) => `${kHead}${sampleOf(clips)}${kLayers}${kBehind}
uniform sampler2D u_nearest;
uniform bool u_takes_rest;  // The last layer holds all surfaces that are left.
uniform vec2 u_outweigh;  // Exponent by depth range, and the largest one.
layout(location = 0) out vec4 means;
#if CLIPS
layout(location = 1) out vec4 away;
#endif
void main() {
  Sample s = splat();
  if (!(s.beta < u_cutoff)) discard;
  vec3 nearest = texelFetch(u_nearest, ivec2(gl_FragCoord.xy), 0).xyz;
  bool same_side = ((int(nearest.y) ^ int(v_place.w)) & 1) == 0;
  if (!u_takes_rest && (!same_side || s.depth + s.epsilon < nearest.x)) discard;
  if (!is_behind(s)) discard;
  float rho = s.amplitude * exp(-s.beta) * left();
  means = vec4(rho, rho * (1.0 - s.depth / nearest.x), rho * v_more.y, 0);
  if (u_opaque) {
    means.z = exp(clamp(u_outweigh.x * (s.center - nearest.x) / nearest.z, -u_outweigh.y, u_outweigh.y));
    means.w = means.z * v_more.z;
  }
#if CLIPS
  away = vec4(v_line1.x < 1e17 ? s.amplitude * exp(-s.beta) * (1.0 - left()) * v_line2.w : 0.0, 0, 0, 0);
#endif
}
`;

/** Textures that the sums of a layer take. */
export const texturesOf = (clips) => (clips ? 3 : 2);

const eachOf = (count, text) => Array.from({ length: count }, (_, i) => text(i)).join('');

/** The attribute pass: sums over the fragments of some layers. */
export const sumFragment = (count, clips) => `${kHead}${sampleOf(clips)}${kLayers}
uniform int u_layers, u_from;  // Layers that there are, and the first one that is summed up.
flat in vec4 v_color;
flat in vec3 v_normal;
${eachOf(count, (i) => `layout(location = ${texturesOf(clips) * i}) out vec4 colors${i};  // rho alpha colour; rho.
layout(location = ${texturesOf(clips) * i + 1}) out vec4 normals${i};  // rho normal; rho alpha.
${clips ? `layout(location = ${3 * i + 2}) out vec4 cuts${i};` : ''}  // Sums of what half-planes cut off: kCutAway and on.
`)}
int taken = -1;
bool done = false;
void offer(int layer, sampler2D nearest, sampler2D means, sampler2D away, Sample s) {
  if (done || layer >= u_layers) return;
  Found f = found(nearest, means, away);
  bool takes = f.flags != 0 && (joins(f, s) || (layer > 0 && layer + 1 == u_layers));
  if (takes) taken = layer - u_from;
  done = takes || f.flags == 0 || hides(f, s);
}
void main() {
  Sample s = splat();
  if (!(s.beta < u_cutoff)) discard;
  offer(0, u_nearest1, u_means1, u_away1, s);
  offer(1, u_nearest2, u_means2, u_away2, s);
  offer(2, u_nearest3, u_means3, u_away3, s);
  offer(3, u_nearest4, u_means4, u_away4, s);
  if (taken < 0 || taken >= ${count}) discard;
  float rho = s.amplitude * exp(-s.beta);
#if CLIPS
  vec4 cut = vec4(0);
  if (v_line1.x < 1e17 && min(arguments.x, arguments.y) < kWhole) {
    vec3 share = shares();
    cut.x = rho * (1.0 - share.x) * v_line2.w;
    rho *= share.x;
    vec2 partial = rho * (1.0 - share.yz);
    cut.y = partial.x + partial.y;
    cut.zw = partial.x * v_outward.xy + partial.y * v_outward.zw;
  }
${clips ? eachOf(count, (i) => `  cuts${i} = taken == ${i} ? cut : vec4(0);\n`) : ''}
#endif
${eachOf(count, (i) => `  float rho${i} = taken == ${i} ? rho : 0.0;
  colors${i} = rho${i} * vec4(v_color.rgb, 1);
  normals${i} = rho${i} * vec4(v_normal, v_color.a);
`)}}
`;
