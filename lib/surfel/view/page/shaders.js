// The programs of the graphics processor. Names and equations are those of surfel-render: Zwicker,
// Pfister, van Baar, Gross, "Surface Splatting", 2001 (SS01). Row 0 of every texture is the top row
// of the picture, so that gl_FragCoord is a place in the picture.

const kHead = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
`;

/**
 * What surfels are to the screen: a quad around each one's kernel, or a point as large.
 * @param attributes  whether colours and normals are wanted.
 */
export const splatVertex = (attributes) => `${kHead}
#define ATTRIBUTES ${attributes ? 1 : 0}
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

flat out vec4 v_place;  // Centre, pixels; amplitude; flags.
flat out vec4 v_a, v_b, v_c;
flat out float v_pixel2;
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
  float s_u = max(exp2(t0.w + t1.w * float(first.y >> 16)) * grown, least);
  float s_v = max(exp2(t0.w + t1.w * float(second.x >> 16)) * grown, least);

  vec3 p = u_rotation * world + u_translation;
  vec3 world_normal = direction(first.z);
  float distance = length(p);
  bool known = world_normal != vec3(0);
  vec3 n = known ? u_rotation * world_normal : -p / distance;
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
  float inv_z = 1.0 / p.z;
  vec2 slope = p.xy * inv_z;
  vec2 center = u_focal * slope + u_center;
  vec2 per_unit = u_focal * inv_z;
  vec2 Jt = per_unit * s_u * (t.xy - slope * t.z);
  vec2 Jb = per_unit * s_v * (b.xy - slope * b.z);
  float xx = Jt.x * Jt.x + Jb.x * Jb.x;
  float yy = Jt.y * Jt.y + Jb.y * Jb.y;
  float h2 = u_lowpass2;
  vec3 Sigma = vec3(xx + h2, Jt.x * Jt.y + Jb.x * Jb.y, yy + h2);
  float n_ray = dot(n, vec3(slope, 1));
  float det_J = per_unit.x * per_unit.y * abs(n_ray);
  float det_JV = det_J * s_u * s_v;
  float det = det_JV * det_JV + h2 * (xx + yy + h2);

  float n_p = dot(n, p);
  float cosine = abs(n_p) / distance;
  float inv_cosine = 1.0 / max(cosine, 0.1);
  float deviation = max(s_u, s_v);
  float pixel = sqrt(h2) / min(u_focal.x, u_focal.y);
  float radius = sqrt(u_two_c) * deviation;

  // Where the affine approximation (4) may be off by more than the tolerance, every pixel's ray
  // meets the plane by itself.
  float size2 = u_two_c * (xx + yy);
  float depth_extent = radius * sqrt(max(0.0, 1.0 - n.z * n.z));
  bool in_front = p.z - depth_extent > 0.0;
  bool exact = !(in_front && sqrt(size2) * depth_extent <= u_tolerance * (p.z - depth_extent));

  float front = n_p < 0.0 ? 1.0 : 0.0;
  float grazing = inv_cosine > 4.0 ? 4.0 : 0.0;
  float filter_reach = sqrt(u_two_c * h2);
  vec2 lo, hi;
  if (!exact) {
    vec2 reach = sqrt(u_two_c * Sigma.xz);
    lo = center - reach;
    hi = center + reach;
    float diagonal2 = dot(reach, reach);
    float flags = front + grazing + (diagonal2 < 4.0 * u_two_c * h2 ? 2.0 : 0.0) +
                  (diagonal2 < 20.0 * u_two_c * h2 ? 16.0 : 0.0);
    float amplitude = area / (2.0 * kPi) * det_J * inversesqrt(det);
    if (!(amplitude > 1e-15)) return;
    float inv_np = 1.0 / (n_p < 0.0 ? min(n_p, -1e-3 * distance) : max(n_p, 1e-3 * distance));
    float on_plane = pixel * p.z * inv_cosine;
    float footprint = sqrt(u_two_c * (deviation * deviation + on_plane * on_plane));
    v_place = vec4(center, amplitude, flags);
    v_a = vec4(Sigma.y / Sigma.z, 0.5 * Sigma.z / det, 0.5 / Sigma.z, footprint * inv_z * inv_z);
    v_b = vec4(inv_z, n.xy * inv_np / u_focal, 0);
    v_c = vec4(0);
    v_pixel2 = 0.0;
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
    float flags = front + 32.0 + (cosine < 0.25 ? 4.0 : 0.0) +
                  (disc2 < 2.0 * filter_reach * filter_reach ? 2.0 : 0.0) +
                  (disc2 < 18.0 * filter_reach * filter_reach ? 16.0 : 0.0);
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
    v_pixel2 = on_pixel * on_pixel;
  }

#if ATTRIBUTES
  vec4 code = vec4(first.w & 255u, first.w >> 8 & 255u, first.w >> 16 & 255u, first.w >> 24) / 255.0;
  vec3 color = t2.z + t2.w * linear_of(code.rgb);
  vec3 shown = u_mapped ? direction(texelFetch(u_shading, at, 0).x) : world_normal;
  if (u_mode == 1) color = known ? linear_of(0.5 * world_normal + 0.5) : linear_of(vec3(0.25));
  if (u_mode == 3) {
    float share = float(second.y >> 16 & 255u) / 255.0;
    color = texelFetch(u_map, ivec2(int(share * 255.0 + 0.5), 0), 0).rgb;
  }
  v_color = vec4(color * code.a, code.a);
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

const kSample = `
flat in vec4 v_place, v_a, v_b, v_c;
flat in float v_pixel2;
uniform float u_cutoff, u_epsilon, u_lowpass2;

struct Sample { float beta, depth, epsilon, amplitude; };

Sample splat() {
  vec2 d = gl_FragCoord.xy - v_place.xy;
  Sample s;
  if ((int(v_place.w) & 32) == 0) {
    float e = d.x - v_a.x * d.y;
    s.beta = v_a.y * e * e + v_a.z * d.y * d.y;
    s.depth = v_b.x + clamp(dot(v_b.yz, d), -v_a.w, v_a.w);
    s.epsilon = v_a.w * u_epsilon;
    s.amplitude = v_place.z;
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
  s.epsilon = u_epsilon * s.depth * sqrt(v_c.w * s.depth * s.depth + v_pixel2);
  s.amplitude = v_place.z * inversesqrt(det);
  return s;
}
`;

/** Fragments of surfaces that none of the layers before holds. */
const kBehind = `
uniform sampler2D u_nearest1, u_nearest2, u_nearest3;
uniform int u_layer;  // Layers before.
bool joins(sampler2D nearest, Sample s) {
  vec2 first = texelFetch(nearest, ivec2(gl_FragCoord.xy), 0).xy;
  bool same_side = ((int(first.y) ^ int(v_place.w)) & 1) == 0;
  return first.y == 0.0 || (same_side && s.depth + s.epsilon >= first.x);
}
bool is_behind(Sample s) {
  if (u_layer > 0 && joins(u_nearest1, s)) return false;
  if (u_layer > 1 && joins(u_nearest2, s)) return false;
  return u_layer < 3 || !joins(u_nearest3, s);
}
`;

/** The visibility pass: the nearest fragment's depth, and the flags of its splat. */
export const kNearestFragment = `${kHead}${kSample}${kBehind}
uniform float u_depth_scale;
layout(location = 0) out vec2 nearest;
void main() {
  Sample s = splat();
  if (!(s.beta < u_cutoff)) discard;
  if (!is_behind(s)) discard;
  gl_FragDepth = clamp(s.depth * u_depth_scale, 0.0, 1.0);
  nearest = vec2(s.depth, v_place.w + 64.0);
}
`;

/** The attribute pass: sums over the fragments of the nearest one's surface. */
export const kSumFragment = `${kHead}${kSample}${kBehind}
uniform sampler2D u_nearest;
uniform bool u_takes_rest;  // The last layer holds all surfaces that are left.
flat in vec4 v_color;
flat in vec3 v_normal;
layout(location = 0) out vec4 colors;   // rho alpha colour; rho.
layout(location = 1) out vec4 normals;  // rho normal; rho alpha.
void main() {
  Sample s = splat();
  if (!(s.beta < u_cutoff)) discard;
  vec2 nearest = texelFetch(u_nearest, ivec2(gl_FragCoord.xy), 0).xy;
  bool same_side = ((int(nearest.y) ^ int(v_place.w)) & 1) == 0;
  if (!u_takes_rest && (!same_side || s.depth + s.epsilon < nearest.x)) discard;
  if (!is_behind(s)) discard;
  float rho = s.amplitude * exp(-s.beta);
  colors = rho * vec4(v_color.rgb, 1);
  normals = rho * vec4(v_normal, v_color.a);
}
`;

export const kScreenVertex = `${kHead}
void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1);
}
`;

/** Where the latest layer leaves something of the pixel to what is behind it. */
export const kOpenFragment = `${kHead}
uniform sampler2D u_colors, u_normals;
uniform float u_edge_weight;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float weight = texelFetch(u_colors, at, 0).a;
  float alpha = texelFetch(u_normals, at, 0).a;
  if (weight == 0.0 || (weight >= u_edge_weight && alpha >= 0.9995 * weight)) discard;
}
`;

/** The third pass: divides, shades and composites. Colours are premultiplied. */
export const kCompositeFragment = `${kHead}
uniform sampler2D u_nearest1, u_nearest2, u_nearest3, u_nearest4;
uniform sampler2D u_colors1, u_colors2, u_colors3, u_colors4;
uniform sampler2D u_normals1, u_normals2, u_normals3, u_normals4;
uniform int u_mode, u_layers;
uniform bool u_lit, u_mapped;
uniform float u_full, u_mean, u_edge_weight;
uniform mat3 u_world_from_camera;
uniform vec2 u_focal, u_center;
uniform vec3 u_up, u_light, u_light_color, u_sky, u_ground;
uniform vec2 u_depth_range;
uniform sampler2D u_map;
layout(location = 0) out vec4 color;
layout(location = 1) out vec4 sums;  // Of kernels, of backs and of fronts; the nearest depth.

struct Layer { float depth, weight, alpha, cover; int flags; vec3 color, normal; };

Layer layers[4];
int count = 0;

void add_layer(sampler2D nearest, sampler2D colors, sampler2D normals) {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec2 first = texelFetch(nearest, at, 0).xy;
  if (first.y == 0.0) return;
  vec4 color = texelFetch(colors, at, 0);
  vec4 normal = texelFetch(normals, at, 0);
  if (!(color.a > 0.0)) return;
  Layer l;
  l.weight = color.a;
  l.depth = first.x;
  l.flags = int(first.y);
  l.alpha = normal.a / l.weight;
  l.color = normal.a > 0.0 ? color.rgb / normal.a : vec3(0);
  l.normal = normal.xyz;
  l.cover = min(1.0, l.weight / u_full);
  layers[count++] = l;
}

vec3 shade(Layer l) {
  if (u_mode == 2) {
    float z = 1.0 / l.depth;
    float share = clamp((z - u_depth_range.x) / (u_depth_range.y - u_depth_range.x), 0.0, 1.0);
    return texelFetch(u_map, ivec2(int(255.5 - share * 255.0), 0), 0).rgb;
  }
  if (!u_lit) return l.color;
  vec3 ray = u_world_from_camera * vec3((gl_FragCoord.xy - u_center) / u_focal, 1);
  vec3 to_eye = -normalize(ray);
  float size = length(l.normal);
  vec3 n = size > 0.0 ? l.normal / size : to_eye;
  bool away = u_mapped ? size > 0.0 && (l.flags & 1) == 0 : dot(n, to_eye) < 0.0;
  if (away) n = -n;
  if (u_mapped && size > 0.0) n *= min(1.0, size / l.weight);
  vec3 diffuse = 0.5 * (u_sky + u_ground) + dot(n, u_up) * 0.5 * (u_sky - u_ground) +
                 max(0.0, dot(n, u_light)) * u_light_color;
  return l.color * diffuse;
}

bool is_front(Layer l) { return (l.flags & 1) != 0; }
bool is_near(Layer a, Layer b) { return abs(a.depth - b.depth) <= 0.02 * abs(a.depth); }
bool at_rims(Layer a, Layer b) { return (a.flags & b.flags & 4) != 0; }

// Beyond the silhouette of a body the planes of its sides have crossed: its front is seen.
void order_by_sight() {
  for (int i = 0; i + 1 < count; ++i) {
    Layer a = layers[i];
    Layer b = layers[i + 1];
    if (is_front(a) || !is_front(b)) continue;
    if ((a.cover < 1.0 && b.cover < 1.0) || (at_rims(a, b) && is_near(a, b))) {
      layers[i] = b;
      layers[i + 1] = a;
    }
  }
}

// Parts of one surface that come as several layers cover the pixel by their sums.
void share_by_sums() {
  float total = 0.0;
  for (int i = 0; i < count; ++i) total += layers[i].weight;
  float several = 1.35 * u_mean;
  float whole = total < several ? u_mean : u_edge_weight;
  int first = 0;
  for (int guard = 0; guard < 4 && first + 1 < count; ++guard) {
    float sum = layers[first].weight;
    float open = 1.0 - layers[first].cover;
    int end = first + 1;
    if ((layers[first].flags & 2) != 0 && sum < whole) {
      for (; end < count; ++end) {
        bool follows = (layers[end].flags & 2) != 0 && is_near(layers[end - 1], layers[end]) &&
                       is_front(layers[end]) == is_front(layers[end - 1]);
        if (!follows || sum + layers[end].weight >= several) break;
        sum += layers[end].weight;
        open *= 1.0 - layers[end].cover;
      }
    }
    if (end - first > 1) {
      float degree = clamp((1.35 - sum / u_mean) / 0.2, 0.0, 1.0);
      float covered = max(1.0 - open, min(1.0, sum / u_edge_weight));
      float transmitted = 1.0;
      for (int i = first; i < end; ++i) {
        float shared =
            transmitted > 0.0 ? min(1.0, covered * layers[i].weight / sum / transmitted) : 1.0;
        transmitted *= 1.0 - shared;
        layers[i].cover += degree * (shared - layers[i].cover);
      }
    }
    first = end;
  }
}

void main() {
  add_layer(u_nearest1, u_colors1, u_normals1);
  if (u_layers > 1) add_layer(u_nearest2, u_colors2, u_normals2);
  if (u_layers > 2) add_layer(u_nearest3, u_colors3, u_normals3);
  if (u_layers > 3) add_layer(u_nearest4, u_colors4, u_normals4);
  color = vec4(0);
  sums = vec4(0);
  if (count == 0) return;
  sums.z = layers[0].depth;
  sums.w = float(layers[0].flags);
  for (int i = 0; i < count; ++i) {
    bool shows_front = is_front(layers[i]);
    sums.xy += layers[i].weight * vec2(!shows_front, shows_front);
  }
  order_by_sight();
  share_by_sums();
  // The sides of a body cover the same part of the pixel at its silhouette.
  float front = 0.0;
  float back = 0.0;
  float before = 1.0;
  float after = 1.0;
  int last_front = -1;
  vec3 front_color = vec3(0);
  for (int i = 0; i < count; ++i) {
    Layer l = layers[i];
    vec3 shown = shade(l);
    float transmitted = 1.0 - color.a;
    float cover = l.cover;
    if (is_front(l)) {
      bool another = back > 0.0 || front >= 1.0;
      if (another || front == 0.0) before = transmitted;
      front = another ? cover : front + (1.0 - front) * cover;
      back = 0.0;
      last_front = i;
      front_color = shown;
    } else if (last_front >= 0 && front > 0.0 && at_rims(layers[last_front], l)) {
      if (back == 0.0) after = transmitted;
      float joint = back + (1.0 - back) * cover;
      float beyond = max(0.0, joint - max(front, back));
      float hidden = (cover - beyond) * (1.0 - (1.0 - after / before) / front);
      back = joint;
      float independent = cover * transmitted;
      if (independent > 0.0) {
        float share = min(1.0, (beyond + hidden) * before / independent);
        float others = min(share, beyond * before / independent);
        shown = share > 0.0 ? mix(shown, front_color, others / share) : shown;
        cover *= share;
      }
    }
    color += transmitted * cover * l.alpha * vec4(shown, 1);
  }
}
`;

/** Sums over their mean, filtered along rows: EdgeCoverage of surfel-render. */
export const kSumsFragment = `${kHead}
uniform sampler2D u_sums;
uniform float u_inv_mean;
uniform vec3 u_taps;
uniform ivec2 u_last;
layout(location = 0) out float smooth_sum;
float sum_at(int x) {
  vec2 sides = texelFetch(u_sums, ivec2(clamp(x, 0, u_last.x), int(gl_FragCoord.y)), 0).xy;
  return min(1.0, max(sides.x, sides.y) * u_inv_mean);
}
void main() {
  int x = int(gl_FragCoord.x);
  smooth_sum = u_taps.x * sum_at(x) + u_taps.y * (sum_at(x - 1) + sum_at(x + 1)) +
               u_taps.z * (sum_at(x - 2) + sum_at(x + 2));
}
`;

/** The same along columns. */
export const kColumnsFragment = `${kHead}
uniform sampler2D u_rows;
uniform vec3 u_taps;
uniform ivec2 u_last;
layout(location = 0) out float smooth_sum;
float sum_at(int y) {
  return texelFetch(u_rows, ivec2(int(gl_FragCoord.x), clamp(y, 0, u_last.y)), 0).x;
}
void main() {
  int y = int(gl_FragCoord.y);
  smooth_sum = u_taps.x * sum_at(y) + u_taps.y * (sum_at(y - 1) + sum_at(y + 1)) +
               u_taps.z * (sum_at(y - 2) + sum_at(y + 2));
}
`;

/** The least filtered sum along rows. */
export const kLeastFragment = `${kHead}
uniform sampler2D u_smooth;
uniform int u_reach;
uniform ivec2 u_last;
layout(location = 0) out float least;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  least = 1.0;
  for (int i = -u_reach; i <= u_reach; ++i) {
    least = min(least, texelFetch(u_smooth, ivec2(clamp(at.x + i, 0, u_last.x), at.y), 0).x);
  }
}
`;

/** Opacities at edges, the background, and codes of sRGB. */
export const kFinalFragment = `${kHead}
uniform sampler2D u_color, u_smooth, u_least, u_sharpen, u_sums, u_relief;
uniform bool u_edges, u_has_relief;
uniform int u_reach, u_height;
uniform ivec2 u_last, u_offset;
uniform float u_backward;
uniform vec3 u_background;
layout(location = 0) out vec4 color;

float smooth_at(ivec2 at) { return texelFetch(u_smooth, clamp(at, ivec2(0), u_last), 0).x; }

float sharpened(float sum, float laplacian) {
  float place = clamp(sum, 0.0, 1.0) * 512.0;
  int i = min(int(place), 511);
  float straight = mix(texelFetch(u_sharpen, ivec2(i, 0), 0).x,
                       texelFetch(u_sharpen, ivec2(i + 1, 0), 0).x, place - float(i));
  float difference = sum - u_backward * laplacian - straight;
  bool small = sum < 0.3 && laplacian < 0.0;
  float uneven = small ? 0.0 : min(min(0.03, 0.1 * sum), sum * sum);
  return clamp(straight + difference - clamp(difference, -uneven, uneven), 0.0, 1.0);
}

vec3 code_of(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy) - u_offset;
  at.y = u_height - 1 - at.y;
  vec4 seen = texelFetch(u_color, at, 0);
  float flags = texelFetch(u_sums, at, 0).w;
  bool kept = flags > 0.0 && (int(flags) & 16) == 0;
  if (u_edges && !kept) {
    float low = 1.0;
    for (int i = -u_reach; i <= u_reach; ++i) {
      low = min(low, texelFetch(u_least, ivec2(at.x, clamp(at.y + i, 0, u_last.y)), 0).x);
    }
    if (low < 0.5) {
      float sum = smooth_at(at);
      float laplacian = smooth_at(at + ivec2(1, 0)) + smooth_at(at - ivec2(1, 0)) +
                        smooth_at(at + ivec2(0, 1)) + smooth_at(at - ivec2(0, 1)) - 4.0 * sum;
      float edge = min(1.0, (0.5 - low) / 0.2);
      float opacity = seen.a + edge * (sharpened(sum, laplacian) - seen.a);
      if (seen.a < 1.0 / 4096.0 && opacity >= 1.0 / 4096.0) {
        // No kernel reaches the pixel: it has the mean colour around it.
        vec4 around = vec4(0);
        for (int y = -2; y <= 2; ++y) {
          for (int x = -2; x <= 2; ++x) {
            around += texelFetch(u_color, clamp(at + ivec2(x, y), ivec2(0), u_last), 0);
          }
        }
        seen = around.a > 0.0 ? around / around.a * opacity : vec4(0);
      } else if (seen.a > 0.0) {
        seen *= opacity / seen.a;
      }
    }
  }
  if (u_has_relief) seen.rgb *= texelFetch(u_relief, at, 0).x;
  color = vec4(code_of(seen.rgb + (1.0 - seen.a) * u_background), 1);
}
`;
