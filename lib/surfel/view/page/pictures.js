// The programs that make pictures of sums over splats, pixel by pixel.

import { kHead } from 'surfel/shaders.js';

/** EdgeFilter of surfel-render. */
const kEdges = `
float least_inside(int step) { return max(0.5, 0.93 - 0.2 * float(step)); }
float edge_by(float slack, int step) { return clamp(-slack / min(0.2, 0.06 + 0.04 * float(step)), 0.0, 1.0); }
float coverage_of(float sum, float sharpening) {
  float share = clamp(sum, 0.0, 1.0);
  return clamp(share + sharpening * 1.94 * (share - 0.5) * sqrt(share * (1.0 - share)), 0.0, 1.0);
}
`;

export const kScreenVertex = `${kHead}
void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1);
}
`;

/**
 * What a layer covers: pixels of their own where splats are larger than the pixel filter or cut by lines, else pixels
 * around which it goes on.
 */
const kCovers = `
uniform sampler2D u_means, u_away;
uniform float u_edge_weight;
uniform bool u_opaque, u_cut;
uniform ivec2 u_last;
float steps_at(vec4 sums) { return u_opaque && sums.z > 0.0 ? sums.w / sums.z : 0.0; }
// covers()
bool covers_pixel(ivec2 at, vec4 sums) {
  if (u_cut && texelFetch(u_away, at, 0).x > 1e-3 * sums.x) return false;
  return sums.x >= u_edge_weight && (u_opaque || sums.z >= 0.9995 * sums.x);
}
bool covers(ivec2 at) {
  vec4 sums = texelFetch(u_means, at, 0);
  if (!covers_pixel(at, sums)) return false;
  if (steps_at(sums) >= 7.0 / 3.0) return true;
  for (int y = -2; y <= 2; ++y) {
    for (int x = -2; x <= 2; ++x) {
      ivec2 other = clamp(at + ivec2(x, y), ivec2(0), u_last);
      if (!covers_pixel(other, texelFetch(u_means, other, 0))) return false;
    }
  }
  return true;
}
`;

/** Where the latest layer leaves something of the pixel to what is behind it, as far as that is known. */
export const kOpenFragment = `${kHead}${kCovers}
uniform sampler2D u_nearest;
uniform bool u_summed;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  if (texelFetch(u_nearest, at, 0).y == 0.0 || (u_summed && covers(at))) discard;
}
`;

/** A point around each tile of 8 x 8 pixels some of which are open. */
export const kTileVertex = `${kHead}
uniform sampler2D u_tiles;
uniform int u_across;
uniform vec2 u_size;
void main() {
  ivec2 tile = ivec2(gl_VertexID % u_across, gl_VertexID / u_across);
  bool open = texelFetch(u_tiles, tile, 0).x > 0.0;
  // Points are drawn whose middle lies in the picture.
  vec2 middle = max(min(vec2(tile) * 8.0 + 4.0, u_size - 4.0), vec2(0));
  gl_PointSize = 8.0;
  gl_Position = open ? vec4(middle / u_size * 2.0 - 1.0, 0, 1) : vec4(2, 2, 2, 1);
}
`;

/** Whether there are open pixels among 8 x 8. */
export const kTilesFragment = `${kHead}${kCovers}
layout(location = 0) out float open;
void main() {
  open = 0.0;
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 8; ++x) {
      ivec2 at = min(ivec2(gl_FragCoord.xy) * 8 + ivec2(x, y), u_last);
      if (texelFetch(u_means, at, 0).x > 0.0 && !covers(at)) open = 1.0;
    }
  }
}
`;

/** Sums of rho, negative where the back is seen, and mean depths of two layers each, for pixels around. */
export const kSurfacesFragment = `${kHead}
uniform sampler2D u_nearest1, u_nearest2, u_nearest3, u_nearest4;
uniform sampler2D u_means1, u_means2, u_means3, u_means4;
uniform sampler2D u_colors1, u_colors2, u_colors3, u_colors4;
uniform int u_layers;
layout(location = 0) out vec4 first;
layout(location = 1) out vec4 second;
vec2 surface(sampler2D nearest, sampler2D means, sampler2D colors) {
  ivec2 at = ivec2(gl_FragCoord.xy);
  vec2 near = texelFetch(nearest, at, 0).xy;
  vec2 sums = texelFetch(means, at, 0).xy;
  if (near.y == 0.0) return vec2(0);
  float weight = texelFetch(colors, at, 0).a;
  float depth = sums.x > 0.0 ? near.x * (1.0 - sums.y / sums.x) : near.x;
  return vec2((int(near.y) & 1) != 0 ? weight : -weight, depth);
}
void main() {
  first = vec4(surface(u_nearest1, u_means1, u_colors1), 0, 0);
  second = vec4(0);
  if (u_layers > 1) first.zw = surface(u_nearest2, u_means2, u_colors2);
  if (u_layers > 2) second.xy = surface(u_nearest3, u_means3, u_colors3);
  if (u_layers > 3) second.zw = surface(u_nearest4, u_means4, u_colors4);
}
`;

const cutOf = (layer, clips) => (clips ? `texelFetch(u_cuts${layer}, ivec2(gl_FragCoord.xy), 0)` : 'vec4(0)');

/**
 * The third pass: divides, shades and composites. Colours are premultiplied. What is named after a function or class of
 * surfel-render (a_buffer.cpp, edge_search.cpp) is the same here.
 * @param several  whether pixels may have several layers, or edges that are not found later; programs of the processor
 *                 take the time of all branches.
 * @param clips    whether half-planes may cut surfels; only with several.
 */
export const compositeFragment = (several, clips = false) => `${kHead}${kEdges}
#define SEVERAL ${several ? 1 : 0}
#define CLIPS ${clips ? 1 : 0}
uniform sampler2D u_nearest1, u_nearest2, u_nearest3, u_nearest4;
uniform sampler2D u_means1, u_means2, u_means3, u_means4;
uniform sampler2D u_surfaces1, u_surfaces2;
uniform sampler2D u_colors1, u_colors2, u_colors3, u_colors4;
uniform sampler2D u_normals1, u_normals2, u_normals3, u_normals4;
#if CLIPS
uniform sampler2D u_cuts1, u_cuts2, u_cuts3, u_cuts4;
#endif
uniform int u_mode, u_layers;
uniform bool u_lit, u_mapped, u_opaque, u_ortho;
uniform float u_far;
uniform float u_full, u_mean, u_edge_weight, u_inv_mean;
uniform mat3 u_world_from_camera;
uniform vec2 u_focal, u_center;
uniform vec3 u_up, u_light, u_light_color, u_sky, u_ground;
uniform vec2 u_depth_range;
uniform sampler2D u_map;
uniform ivec2 u_last;
layout(location = 0) out vec4 color;
layout(location = 1) out vec4 sums;  // Over the mean: of the surface that counts; what all have beyond the least inside. Step.
uniform vec4 u_completing[8];  // EdgeFilter: taps by distance, and sharpening; by spacing_step().

struct Layer { float depth, weight, alpha, cover, edge; int flags; int step; bool far, one_body; vec3 color, normal; vec4 cut; vec2 slope; };

float slope_of(float code) { return sign(code - 2048.0) * (exp2(abs(code - 2048.0) / 100.0) - 1.0) * 1e-5; }

Layer layers[4];
int count = 0;

void add_layer(vec2 surface, sampler2D nearest, sampler2D means, sampler2D colors, sampler2D normals, vec4 cut) {
  ivec2 at = ivec2(gl_FragCoord.xy);
  if (surface.x == 0.0) return;
  vec4 color = texelFetch(colors, at, 0);
  vec4 normal = texelFetch(normals, at, 0);
  Layer l;
  l.weight = color.a;
  l.depth = surface.y;
  vec4 near = texelFetch(nearest, at, 0);
  l.flags = int(near.y);
  l.slope = near.x * vec2(slope_of(floor(near.w / 4096.0)), slope_of(mod(near.w, 4096.0)));
  vec2 first = texelFetch(means, at, 0).zw;
  float steps = u_opaque && first.x > 0.0 ? first.y / first.x : 0.0;
  l.step = int(steps + 1e-3);
  if (steps < 7.0 / 3.0) l.flags |= 2;
  l.alpha = normal.a / l.weight;
  l.color = normal.a > 0.0 ? color.rgb / normal.a : vec3(0);
  l.normal = normal.xyz;
  l.edge = 0.0;
  l.far = false;
  l.cut = cut;
  int place = count++;
  for (; place > 0 && layers[place - 1].depth < l.depth; --place) layers[place] = layers[place - 1];
  layers[place] = l;
}

vec3 shade(Layer l) {
  if (u_mode == 2) {
    float z = u_ortho ? u_far - l.depth : 1.0 / l.depth;
    float share = clamp((z - u_depth_range.x) / (u_depth_range.y - u_depth_range.x), 0.0, 1.0);
    return texelFetch(u_map, ivec2(int(255.5 - share * 255.0), 0), 0).rgb;
  }
  if (!u_lit) return l.color;
  vec3 ray = u_world_from_camera * vec3(u_ortho ? vec2(0) : (gl_FragCoord.xy - u_center) / u_focal, 1);
  vec3 to_eye = -normalize(ray);
  float size = length(l.normal);
  vec3 n = size > 0.0 ? l.normal / max(l.weight, size) : to_eye;
  bool away = u_mapped ? size > 0.0 && (l.flags & 1) == 0 : dot(n, to_eye) < 0.0;
  if (away) n = -n;
  vec3 diffuse = 0.5 * (u_sky + u_ground) + dot(n, u_up) * 0.5 * (u_sky - u_ground) +
                 max(0.0, dot(n, u_light)) * u_light_color;
  return l.color * diffuse;
}

bool is_front(Layer l) { return (l.flags & 1) != 0; }
bool is_filtered(Layer l) { return (l.flags & 2) != 0; }
bool is_cut(Layer l) { return l.cut.y > 0.0; }
#if SEVERAL
// kRimDepth
float rim_depth(Layer l) { return 0.02 * (u_ortho ? u_far - l.depth : l.depth); }
bool is_near(Layer a, Layer b) { return abs(a.depth - b.depth) <= rim_depth(a); }
bool at_rims(Layer a, Layer b) { return (a.flags & b.flags & 4) != 0; }

// EdgeNeighbors: what continues a layer in the pixels around.
const float kOutside = -1.0;
const float kFar = -3e38;
float leading, nearest_front;

float continued(Layer l, ivec2 at) {
  if (any(lessThan(at, ivec2(0))) || any(greaterThan(at, u_last))) return kOutside;
  vec4 first = texelFetch(u_surfaces1, at, 0);
  vec4 second = texelFetch(u_surfaces2, at, 0);
  vec4 weight = vec4(first.xz, second.xz);
  vec4 depth = vec4(first.yw, second.yw);
  float side = is_front(l) ? 1.0 : -1.0;
  float least = 3e38;
  float found = 0.0;
  float sum = 0.0;
  float nearest = kFar;
  for (int i = 0; i < 4; ++i) {
    if (weight[i] == 0.0) continue;
    if (abs(weight[i]) >= 0.05) nearest = max(nearest, depth[i]);
    if (weight[i] >= 0.05) nearest_front = max(nearest_front, depth[i]);
    float distance = abs(depth[i] - l.depth);
    if (weight[i] * side > 0.0 && distance < least) {
      least = distance;
      sum = abs(weight[i]);
      found = depth[i];
    }
  }
  if (sum > 0.0 && found >= nearest) leading = max(leading, sum);
  return sum;
}

void look_around(inout Layer l) {
  ivec2 at = ivec2(gl_FragCoord.xy);
  leading = kFar;
  nearest_front = kFar;
  continued(l, at);
  for (int i = -2; i <= 2; ++i) {
    if (i == 0) continue;
    continued(l, at + ivec2(i, 0));
    continued(l, at + ivec2(0, i));
  }
  bool close = nearest_front - l.depth <= 0.3 * (u_ortho ? u_far - l.depth : l.depth);
  l.far = leading < 0.8 * u_edge_weight && nearest_front >= l.depth - rim_depth(l) &&
          (is_filtered(l) || is_cut(l) || close);
  if (l.far && is_filtered(l)) l.edge = 1.0;
}

// PixelSurfaces: which layers are slabs of one surface, and the depths that are the surface's around the pixel.
int surface_of[4];
float surface_sum[4], surface_last[4], surface_nearest[4], surface_farthest[4];
void find_surfaces() {
  int last[2] = int[2](-1, -1);
  for (int i = 0; i < count; ++i) {
    Layer l = layers[i];
    int side = is_front(l) ? 1 : 0;
    int before = last[side];
    bool goes_on = before >= 0 && l.weight < 0.85 * u_mean && surface_sum[before] + l.weight < 1.35 * u_mean &&
                   surface_last[before] - l.depth <= (at_rims(layers[before], l) ? 2.5 : 1.0) * rim_depth(l);
    if (!goes_on) {
      surface_sum[i] = 0.0;
      surface_nearest[i] = 3e38;
      surface_farthest[i] = kFar;
      if (before >= 0) surface_farthest[before] = surface_nearest[i] = 0.5 * (surface_last[before] + l.depth);
      before = last[side] = i;
    }
    surface_sum[before] += l.weight;
    surface_last[before] = l.depth;
    surface_of[i] = before;
  }
}

// SurfaceSum: a surface's sum over its mean in a pixel.
float sum_around(int surface, bool front, ivec2 offset) {
  ivec2 at = clamp(ivec2(gl_FragCoord.xy) + offset, ivec2(0), u_last);
  vec4 first = texelFetch(u_surfaces1, at, 0);
  vec4 second = texelFetch(u_surfaces2, at, 0);
  vec4 weight = vec4(first.xz, second.xz) * (front ? 1.0 : -1.0);
  vec4 depth = vec4(first.yw, second.yw);
  float sum = 0.0;
  float nearer = 0.0;
  for (int i = 0; i < 4; ++i) {
    if (weight[i] <= 0.0) continue;
    if (depth[i] >= surface_nearest[surface]) {
      nearer += weight[i];
    } else if (depth[i] > surface_farthest[surface]) {
      sum += weight[i];
    }
  }
  return nearer >= 0.85 * u_mean ? 1.15 : min(1.15, sum * u_inv_mean);
}

// EdgeFilter::edge_of(): the degree to which the pixel is at the edge of a surface, and its coverage there.
vec2 edge_of(int surface, bool front, int step) {
  float middle = 0.0;
  for (int y = -1; y <= 1; ++y) {
    for (int x = -1; x <= 1; ++x) middle += sum_around(surface, front, ivec2(x, y));
  }
  float degree = edge_by(middle / 9.0 - least_inside(step), step);
  if (degree < 1.0) {
    float least = 9.0;
    for (int i = -2; i <= 2; i += 2) {
      for (int side = 0; side < 4; ++side) {
        float sum = 0.0;
        for (int k = i - 1; k <= i + 1; ++k) {
          int end = side < 2 ? 3 : -3;
          sum += sum_around(surface, front, side % 2 == 0 ? ivec2(k, end) : ivec2(end, k));
        }
        least = min(least, sum / 3.0);
      }
    }
    degree = max(degree, edge_by(least - least_inside(step), step));
    if (degree == 0.0) return vec2(0, 1);
  }
  float sum = 0.0;
  for (int y = -2; y <= 2; ++y) {
    for (int x = -2; x <= 2; ++x) {
      sum += u_completing[step][abs(x)] * u_completing[step][abs(y)] * sum_around(surface, front, ivec2(x, y));
    }
  }
  float own = sum_around(surface, front, ivec2(0));
  sum = min(sum, own * u_mean + 1.05 - u_mean);
  if (sum < 0.3) sum = max(sum, own);
  return vec2(degree, coverage_of(sum, u_completing[step].w));
}

// TileABuffer::full_weight_of()
float full_weight(Layer l) {
  float full = u_full + (u_edge_weight - u_full) * l.edge;
  if (!is_cut(l)) return full;
  float aligned = length(l.cut.zw) / l.cut.y;
  float corner = clamp((l.weight / u_mean - 0.75) / 0.3, 0.0, 1.0) * clamp((aligned - 0.95) / -0.15, 0.0, 1.0);
  float one_side = clamp((aligned - 0.4) / 0.55, 0.0, 1.0) * (1.0 - corner);
  float uncut = l.weight + l.cut.x;
  if (is_filtered(l)) uncut = clamp(uncut, u_mean * l.edge, u_mean);
  return full + one_side * max(0.0, uncut - full);
}

// PartsBesideLines: what layers that end at lines cover together.
float beside_coverage = 0.0;
vec2 beside_outward;
bool beside_front;
float beside_lines(Layer l) {
  vec2 outward = l.cut.zw / l.cut.y;
  float independent = l.cover * (1.0 - beside_coverage);
  if (beside_coverage == 0.0 || !(independent > 0.0)) {
    if (beside_coverage == 0.0) {
      beside_coverage = l.cover;
      beside_outward = outward;
      beside_front = is_front(l);
    }
    return 1.0;
  }
  float alike = clamp(dot(outward, beside_outward), -1.0, 1.0);
  float beyond = is_front(l) == beside_front ? max(0.0, l.cover - beside_coverage) : 0.0;
  float added = alike > 0.0 ? beyond : min(l.cover, 1.0 - beside_coverage);
  float adds = independent + abs(alike) * (added - independent);
  beside_coverage += adds;
  return adds / independent;
}

// Pixels that PlainPixels resolves, which takes no back for the far side of a body.
bool is_plain() {
  float total = 0.0;
  for (int i = 0; i < count; ++i) total += layers[i].weight;
  bool loose_back = false;
  bool rim = false;
  bool beside_line = false;
  for (int i = 0; i < count; ++i) {
    Layer l = layers[i];
    bool part = l.weight < full_weight(l);
    bool grazing = (l.flags & 4) != 0;
    bool loose = part || grazing;
    if (is_filtered(l) && (i + 1 < count || l.weight < u_edge_weight || (total < 1.35 * u_mean && l.weight < u_mean))) return false;
    if (beside_line && (is_cut(l) || !is_front(l))) return false;
    if (is_front(l) ? loose_back && loose : l.weight < u_edge_weight || (grazing && (!part || rim))) return false;
    if (!part) return true;
    loose_back = !is_front(l) && loose;
    rim = is_front(l) && part && grazing;
    beside_line = beside_line || is_cut(l);
  }
  return true;
}

void find_edges() {
  bool plain = u_opaque && count > 1 && is_plain();
  bool hidden = plain;
  vec2 edges[4];
  float open[4];
  bool known[4] = bool[4](false, false, false, false);
  find_surfaces();
  for (int i = 0; i < count; ++i) {
    Layer l = layers[i];
    // Opacities of single opaque surfaces are found later.
    bool last = i + 1 == count;
    bool partial = !(u_opaque && !is_cut(l)) && l.weight < (u_opaque ? u_edge_weight : 1.15 * u_mean);
    bool may_end = u_layers > 1 && !hidden && is_filtered(l) && (last || !u_opaque ? partial : true);
    bool may_be_far = u_layers > 1 && !plain && u_opaque && count > 1 && !is_front(l);
    layers[i].one_body = false;
    if (may_be_far) look_around(layers[i]);
    int surface = surface_of[i];
    if (may_end && !known[surface]) {
      known[surface] = true;
      edges[surface] = edge_of(surface, is_front(l), l.step);
      open[surface] = 1.0;
    }
    if (may_end) layers[i].edge = layers[i].far ? 1.0 : edges[surface].x;
    layers[i].cover = min(1.0, l.weight / full_weight(layers[i]));
    if (may_end && !is_cut(l) && edges[surface].x > 0.0) {
      // Layers of one surface share what it covers.
      float part = edges[surface].y * l.weight / surface_sum[surface];
      float cover = open[surface] > 0.0 ? min(1.0, part / open[surface]) : 1.0;
      open[surface] -= part;
      float inside = min(1.0, l.weight / u_full);
      layers[i].cover = max(1e-6, inside + layers[i].edge * (cover - inside));
    }
    hidden = hidden || (u_opaque && layers[i].cover >= 0.9 && is_front(l));
  }
}

// Surfaces that cross share the pixel by what the pixel filter has on either side of the line.
bool is_slanted(Layer l) { return is_filtered(l) && (l.flags & 4) == 0 && l.weight >= 0.85 * u_mean; }
void cross_layers() {
  for (int i = 0; i + 1 < count && u_opaque; ++i) {
    int next = i + 1;
    while (next < count && !is_slanted(layers[next])) ++next;
    if (!is_slanted(layers[i]) || next == count || at_rims(layers[i], layers[next])) continue;
    float slope = length(layers[i].slope - layers[next].slope);
    float gap = layers[i].depth - layers[next].depth;
    if (!(gap < 4.0 * slope)) continue;
    float d = gap / slope;
    float cover = 0.5 + 0.5 * sign(d) * sqrt(1.0 - exp(-0.63661977 * d * d));
    if (cover >= layers[i].cover) continue;
    layers[i].cover = cover;
    layers[next].cover = 1.0;
  }
}

// Beyond the silhouette of a body the planes of its sides have crossed: its front is seen.
void order_by_sight() {
  int first_back = 0;
  bool covered = false;
  bool far_sides = true;
  for (int i = 0; i < count; ++i) {
    Layer l = layers[i];
    bool part = l.cover < 1.0;
    if (!is_front(l) && (part || l.far || (l.flags & 4) != 0)) {
      covered = covered || !part;
      far_sides = far_sides && l.far;
      continue;
    }
    if (is_front(l) && first_back < i &&
        (far_sides || (part && !covered) || (at_rims(layers[first_back], l) && is_near(layers[first_back], l)))) {
      l.one_body = true;
      for (int k = i; k > first_back; --k) layers[k] = layers[k - 1];
      layers[first_back] = l;
      ++first_back;
      far_sides = false;
    } else {
      first_back = i + 1;
      covered = false;
      far_sides = !is_front(l);
    }
  }
}

// Parts of one surface that come as several layers cover the pixel by their sums.
bool is_part(Layer l) { return is_filtered(l) && !is_cut(l); }
void share_by_sums() {
  if (!u_opaque || count < 2) return;
  float total = 0.0;
  for (int i = 0; i < count; ++i) total += layers[i].weight;
  float several = 1.35 * u_mean;
  float whole = total < several ? u_mean : u_edge_weight;
  int first = 0;
  for (int guard = 0; guard < 4 && first + 1 < count; ++guard) {
    float sum = layers[first].weight;
    float open = 1.0 - layers[first].cover;
    int end = first + 1;
    if (is_part(layers[first]) && sum < whole) {
      for (; end < count; ++end) {
        bool follows = is_part(layers[end]) && is_near(layers[end - 1], layers[end]) &&
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
#endif

void main() {
  vec4 s1 = texelFetch(u_surfaces1, ivec2(gl_FragCoord.xy), 0);
  color = vec4(0);
  sums = vec4(0, -least_inside(0), 0, 0);
  add_layer(s1.xy, u_nearest1, u_means1, u_colors1, u_normals1, ${cutOf(1, clips)});
#if SEVERAL
  vec4 s2 = texelFetch(u_surfaces2, ivec2(gl_FragCoord.xy), 0);
  if (u_layers > 1) add_layer(s1.zw, u_nearest2, u_means2, u_colors2, u_normals2, ${cutOf(2, clips)});
  if (u_layers > 2) add_layer(s2.xy, u_nearest3, u_means3, u_colors3, u_normals3, ${cutOf(3, clips)});
  if (u_layers > 3) add_layer(s2.zw, u_nearest4, u_means4, u_colors4, u_normals4, ${cutOf(4, clips)});
#endif
  if (count == 0) return;
  vec2 all = vec2(0);  // By side: of all surfaces,
  vec2 largest = vec2(0);  // of the largest one,
  vec2 covered = vec2(0);  // and what they cover if they cover independent parts.
  vec2 nearest = vec2(0);
  vec2 farthest = vec2(0);
  int step = 0;
  for (int i = 0; i < count; ++i) {
    Layer l = layers[i];
    int side = is_front(l) ? 1 : 0;
    float sum = l.weight * u_inv_mean;
    if (largest[side] == 0.0) nearest[side] = l.depth;
    farthest[side] = l.depth;
    all[side] += sum;
    largest[side] = max(largest[side], sum);
    covered[side] += (1.0 - covered[side]) * min(1.0, sum);
    step = max(step, is_cut(l) && !is_filtered(l) ? 7 : l.step);
  }
  vec2 one = largest;
  for (int side = 0; side < 2; ++side) {
    if (nearest[side] - farthest[side] > 0.02 * abs(nearest[side])) one[side] = max(one[side], covered[side]);
  }
  float larger = max(one.x, one.y);
  float smaller = min(one.x, one.y);
  float both = clamp((smaller - 0.7 * larger) / 0.2, 0.0, larger);
  float share = larger - both / larger * (larger - smaller) / 2.0;
  float slack = min(1.15, max(all.x, all.y)) - least_inside(step);
#if SEVERAL
  find_edges();
  cross_layers();
  order_by_sight();
  share_by_sums();
  // TwoSides: the sides of a body cover the same part of the pixel at its silhouette.
  float front = 0.0;
  float back = 0.0;
  float before = 1.0;
  float after = 1.0;
  float one_body = 0.0;
  int last_front = -1;
  bool whole = false;
  vec4 front_color = vec4(0);
  for (int i = 0; i < count; ++i) {
    Layer l = layers[i];
    float transmitted = 1.0 - color.a;
    float cover = l.cover;
    vec4 shown = cover * l.alpha * vec4(shade(l), 1);
    float beside = is_cut(l) ? beside_lines(l) : 1.0;
    if (is_front(l)) {
      shown *= beside;
      bool another = back > 0.0 || front >= 1.0;
      if (another || front == 0.0) before = transmitted;
      front = another ? cover : front + (1.0 - front) * cover;
      back = 0.0;
      one_body = l.one_body ? 1.0 : l.edge;
      last_front = i;
      front_color = shown;
    } else {
      bool rim = last_front >= 0 && front_color.a > 0.0 && (l.far || at_rims(layers[last_front], l));
      if (rim) one_body = 1.0;
      float independent = cover * transmitted;
      float all = 1.0;
      vec4 mixed = shown;
      if (front > 0.0 && independent > 0.0) {
        if (back == 0.0) after = transmitted;
        float joint = back + (1.0 - back) * cover;
        float beyond = max(0.0, joint - max(front, back));
        float hidden = (cover - beyond) * (1.0 - (1.0 - after / before) / front);
        back = joint;
        float share = min(1.0, (beyond + hidden) * before / independent);
        all = 1.0 + one_body * (share - 1.0);
        float others = min(all, one_body * beyond * before / independent);
        if (joint >= 1.0) front = back = 0.0;
        float own = rim ? all - others : all;
        mixed.rgb = own * shown.rgb + (rim ? others * shown.a / front_color.a : 0.0) * front_color.rgb;
        mixed.a = all * shown.a;
      }
      shown = is_cut(l) && beside < all ? shown * beside : mixed;
    }
    color += transmitted * shown;
    whole = whole || (is_part(l) && l.weight >= u_edge_weight);
  }
  if (u_opaque && whole && color.a > 0.0) color /= color.a;  // cover()
#else
  Layer l = layers[0];
  color = min(1.0, l.weight / u_full) * l.alpha * vec4(shade(l), 1);
#endif
  sums = step == 7 ? vec4(color.a, color.a - least_inside(7), 7, 0) : vec4(share, slack, step, 0);
}
`;

/** A picture of what sums have beyond the least inside, evened out along an axis: EdgeCoverage of surfel-render. */
const smoothed = (sums, channel, step) => `${kHead}
uniform sampler2D ${sums};
uniform vec3 u_taps;
uniform ivec2 u_last;
layout(location = 0) out float smooth_sum;
float sum_at(int offset) {
  ivec2 at = ivec2(gl_FragCoord.xy) + offset * ${step};
  return texelFetch(${sums}, clamp(at, ivec2(0), u_last), 0).${channel};
}
void main() {
  smooth_sum = u_taps.x * sum_at(0) + u_taps.y * (sum_at(-1) + sum_at(1)) +
               u_taps.z * (sum_at(-2) + sum_at(2));
}
`;
export const kSumsFragment = smoothed('u_sums', 'y', 'ivec2(1, 0)');
export const kColumnsFragment = smoothed('u_rows', 'x', 'ivec2(0, 1)');

/** The least filtered sum along rows. */
export const kLeastFragment = `${kHead}
uniform sampler2D u_smooth;
uniform int u_reach;
uniform ivec2 u_last;
layout(location = 0) out float least;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  least = 9.0;
  for (int i = -u_reach; i <= u_reach; ++i) {
    least = min(least, texelFetch(u_smooth, ivec2(clamp(at.x + i, 0, u_last.x), at.y), 0).x);
  }
}
`;

/** Opacities at edges, the background, and codes of sRGB. */
export const kFinalFragment = `${kHead}${kEdges}
uniform sampler2D u_color, u_least, u_sums, u_relief;
uniform bool u_edges, u_has_relief;
uniform int u_reach, u_height;
uniform ivec2 u_last, u_offset;
uniform vec4 u_completing[8];
uniform vec3 u_background;
layout(location = 0) out vec4 color;

vec3 code_of(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(c * 12.92, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy) - u_offset;
  at.y = u_height - 1 - at.y;
  vec4 seen = texelFetch(u_color, at, 0);
  int step = int(texelFetch(u_sums, at, 0).z);
  if (u_edges && step < 7) {
    float low = 9.0;
    for (int i = -u_reach; i <= u_reach; ++i) {
      low = min(low, texelFetch(u_least, ivec2(at.x, clamp(at.y + i, 0, u_last.y)), 0).x);
    }
    float edge = edge_by(low, step);
    if (edge > 0.0) {
      float sum = 0.0;
      for (int y = -2; y <= 2; ++y) {
        for (int x = -2; x <= 2; ++x) {
          float share = texelFetch(u_sums, clamp(at + ivec2(x, y), ivec2(0), u_last), 0).x;
          sum += u_completing[step][abs(x)] * u_completing[step][abs(y)] * min(1.15, share);
        }
      }
      float opacity = seen.a + edge * (coverage_of(sum, u_completing[step].w) - seen.a);
      if (seen.a < 1.0 / 4096.0 && opacity >= 1.0 / 4096.0) {
        // No kernel reaches the pixel: it has the mean colour around it.
        vec4 around = vec4(0);
        bool kept_around = false;
        for (int y = -2; y <= 2; ++y) {
          for (int x = -2; x <= 2; ++x) {
            ivec2 other = clamp(at + ivec2(x, y), ivec2(0), u_last);
            around += texelFetch(u_color, other, 0);
            kept_around = kept_around || int(texelFetch(u_sums, other, 0).z) == 7;
          }
        }
        seen = around.a > 0.0 && !kept_around ? around / around.a * opacity : vec4(0);
      } else if (seen.a > 0.0) {
        seen *= opacity / seen.a;
      }
    }
  }
  if (u_has_relief) seen.rgb *= texelFetch(u_relief, at, 0).x;
  color = vec4(code_of(seen.rgb + (1.0 - seen.a) * u_background), 1);
}
`;
