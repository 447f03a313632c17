#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <type_traits>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/base/option_check.h>
#include <surfel/base/parallel.h>
#include <surfel/base/progress.h>
#include <surfel/base/stage_timer.h>
#include <surfel/estimate/estimate_blocks.h>
#include <surfel/estimate/forest_sides.h>
#include <surfel/estimate/halo_loader.h>
#include <surfel/estimate/noisy_normals.h>
#include <surfel/estimate/place_sample.h>
#include <surfel/estimate/point_estimates.h>
#include <surfel/estimate/range_normals.h>
#include <surfel/estimate/run_index.h>
#include <surfel/estimate/stored_sides.h>
#include <surfel/estimate/surface_edges.h>
#include <surfel/scene/cloud_rows.h>
#include <surfel/surface/exact_search.h>
#include <surfel/surface/halo_search.h>
#include <surfel/surface/neighbor_lists.h>

namespace surfel {
namespace {

constexpr std::size_t kLoadGrain = 1 << 14;
/// Points of a run: the most, and the least.
constexpr std::size_t kRunLength = 1024;
constexpr std::size_t kLeastRun = 64;
/// Points that are read at once for the index.
constexpr std::size_t kIndexPiece = std::size_t{256} * kRunLength;
/// Runs from which it is guessed whether ellipses are worth it.
constexpr std::size_t kProbes = 16;
/// Bytes that the estimate of a point takes with its place in the search, besides its columns.
constexpr std::size_t kPointBytes = 330;
/// Runs whose boxes meet the box of a run: along a curve through space there are some tens.
constexpr std::size_t kMostMeeting = 64;

/// Number of the checkpoint that says whether ellipses are worth it; blocks have smaller ones.
constexpr std::uint64_t kEllipses = std::numeric_limits<std::uint64_t>::max();

/// Estimates of the points of a block, in the order of the file.
struct CloudBlock : BlockPoints {
  PointEstimates estimates;
  Array<std::uint8_t> turned;  ///< 1 where orientation turned the normal.
  BlockEdges edges;            ///< Made in the pass that looks for them.
  std::size_t components = 0;
};

class BlockEstimator {
 public:
  BlockEstimator(const SurfelRanges& cloud, const EstimateOptions& options,
                 const BlockOptions& blocks, const std::string& name)
      : cloud_(cloud),
        options_(options),
        name_(name),
        grid_(cloud.grid()),
        checkpoints_(blocks.checkpoints),
        peers_(blocks.peers),
        beside_(blocks.beside),
        index_(run_length(cloud, blocks)) {
    grow_in_noise_ = options_.normals.grow_in_noise && !(options_.normals.radius > 0);
    options_.normals.grow_in_noise = false;
    shared_ = shared_neighbors(options_.normals);
    read_index();
    const std::uint64_t point_bytes = kPointBytes + 2 * column_bytes_;
    const std::uint64_t index_bytes = index_.size() * RunIndex::kRunBytes;
    const std::uint64_t memory = blocks.memory - std::min(blocks.memory, index_bytes);
    auto most_loaded = static_cast<std::size_t>(memory / point_bytes);
    if (along_surface()) {
      most_loaded = std::min(most_loaded / 4 * 3, 2 * kMostBlock);
      forest_memory_ = memory - most_loaded * point_bytes;
      of_memory_ = blocks.memory;
    }
    std::size_t points = blocks.most_points;
    if (points == 0) {
      // The halo takes its part.
      points = std::min(most_loaded / 10 * 7, kMostBlock);
      if (points < kRunLength) {
        throw_usage(fmt::format(
            "{} bytes of memory are too few to estimate {} points: give at least {} bytes",
            blocks.memory, index_.points(), index_bytes + 2 * kRunLength * point_bytes));
      }
    } else {
      most_loaded = std::numeric_limits<std::size_t>::max();
      forest_memory_ = std::numeric_limits<std::uint64_t>::max();
    }
    most_loaded_ = most_loaded;
    block_runs_ = std::max<std::size_t>(1, points / index_.length());
    decide();
    if (winding_) require_room_for_tiles(blocks, index_bytes);
    begin_pass(Pass::kSurfels);
  }

  void run(SurfelSink& sink, EstimateReport& report, StageTimer& stage) {
    stage.end("index");
    if (winding_) find_sides();
    if (along_surface()) find_sides_along_surface();
    stage.end("sides");
    const bool decide_ellipses =
        options_.size.rule == VarianceRule::kCover && options_.size.anisotropy == Anisotropy::kAuto;
    ellipses_ =
        options_.size.rule == VarianceRule::kCover && options_.size.anisotropy == Anisotropy::kOn;
    if (decide_ellipses) {
      const std::optional<std::string> known =
          checkpoints_ ? checkpoints_->finished(kEllipses) : std::nullopt;
      ellipses_ = known ? *known == "worth it" : guess_ellipses();
    }
    stage.end("probes");
    for (;;) {
      totals_ = {};
      sink.begin(first_surfel(), index_.finite());
      ProgressStage progress("estimating surfels", index_.points(), "points");
      Place at;
      while (at.run < index_.size()) {
        const std::size_t begin = at.run;
        const std::size_t end = std::min(begin + block_runs_, index_.size());
        if (!mine(begin)) {
          for (; at.run < end; ++at.run) at.surfel += index_[at.run].finite;
        } else if (!restore(at)) {
          CloudBlock block = estimate(begin, end);
          count(block, totals_);
          stage.end("estimates");
          const std::size_t size = block.cloud.size();
          if (size > 0) sink.put(surfels(block), at.surfel);
          at = {end, at.surfel + size};
          keep(begin, at, size);
          stage.end("surfels");
        }
        progress.add(index_.begin(at.run) - index_.begin(begin));
      }
      if (peers_) add_up();
      if (!decide_ellipses) break;
      const bool worth = worth_ellipses(totals_.elongated, index_.finite());
      if (worth == ellipses_) break;
      ellipses_ = worth;
      if (checkpoints_) checkpoints_->finish(kEllipses, {}, worth ? "worth it" : "not worth it");
    }
    fill(report);
  }

 private:
  /// What is made of the points that are loaded.
  enum class Pass : std::uint8_t {
    kNormals,
    kEdges,  ///< Edges to the nearest points.
    kJoins,  ///< Edges between parts that no edge to a nearest point joins.
    kSurfels
  };

  /// A larger block saves hardly any halo, and is no longer in the processor's caches.
  static constexpr std::size_t kMostBlock = std::size_t{1} << 20;

  /// Sums over the points of all blocks.
  struct Totals {
    std::array<std::size_t, kPointFlags> flagged{};
    std::size_t neighbors = 0, extended = 0, flipped = 0, unknown = 0;
    std::size_t border = 0, capped = 0, elongated = 0, components = 0, unusable_colors = 0;
    std::uint64_t confidence = 0;
    Orientation method = Orientation::kNone;
  };

  /// Is a block this process's?
  bool mine(std::size_t begin_run) const {
    if (!peers_) return true;
    const auto block = begin_run / block_runs_;
    return block % static_cast<std::size_t>(peers_->count()) ==
           static_cast<std::size_t>(peers_->rank());
  }

  /// Adds the totals of all processes.
  void add_up() {
    static_assert(std::is_trivially_copyable_v<Totals>);
    const std::vector<std::vector<Totals>> all = gather_lists(peers_, std::vector<Totals>{totals_});
    totals_ = all[0][0];
    for (std::size_t rank = 1; rank < all.size(); ++rank) {
      const Totals& more = all[rank][0];
      for (std::size_t f = 0; f < kPointFlags; ++f) totals_.flagged[f] += more.flagged[f];
      totals_.neighbors += more.neighbors;
      totals_.extended += more.extended;
      totals_.flipped += more.flipped;
      totals_.unknown += more.unknown;
      totals_.border += more.border;
      totals_.capped += more.capped;
      totals_.elongated += more.elongated;
      totals_.unusable_colors += more.unusable_colors;
      totals_.confidence += more.confidence;
      totals_.components = std::max(totals_.components, more.components);
    }
  }

  /// How far the work has come.
  struct Place {
    std::size_t run = 0;
    std::size_t surfel = 0;
  };
  /// What a checkpoint keeps of all blocks up to it.
  struct State {
    std::uint64_t run_length;
    Place next;
    Totals totals;
  };

  /// Goes on behind a block that an earlier run made.
  bool restore(Place& at) {
    static_assert(std::is_trivially_copyable_v<State>);
    if (!checkpoints_) return false;
    const std::optional<std::string> kept = checkpoints_->finished(at.run);
    State state;
    if (!kept || kept->size() != sizeof(state)) return false;
    std::memcpy(&state, kept->data(), sizeof(state));
    if (state.run_length != index_.length()) return false;
    at = state.next;
    totals_ = state.totals;
    return true;
  }

  void keep(std::size_t begin_run, const Place& next, std::size_t surfels) const {
    if (!checkpoints_) return;
    const State state{index_.length(), next, totals_};
    const RowSpan rows{next.surfel - surfels, next.surfel};
    checkpoints_->finish(begin_run, {&rows, 1},
                         std::string(reinterpret_cast<const char*>(&state), sizeof(state)));
  }

  /// Points of a run. Halos are whole runs, which have to be small beside a block; their index has
  /// to be small beside the memory.
  static std::size_t run_length(const SurfelRanges& cloud, const BlockOptions& blocks) {
    if (blocks.most_points > 0) return std::min(kRunLength, blocks.most_points);
    constexpr std::size_t kRunsOfBlock = 64;
    constexpr std::size_t kShareOfIndex = 8;
    const std::uint64_t point_bytes =
        kPointBytes + 2 * (cloud.size() > 0 ? row_bytes(cloud.read(0, 1)) : 0);
    const std::uint64_t of_block = blocks.memory / point_bytes / kRunsOfBlock;
    const std::uint64_t of_index = cloud.size() * RunIndex::kRunBytes * kShareOfIndex /
                                   std::max<std::uint64_t>(1, blocks.memory);
    return std::bit_floor(static_cast<std::size_t>(
        std::clamp<std::uint64_t>(std::max(of_block, of_index), kLeastRun, kRunLength)));
  }

  /// Do sides spread from edge to edge?
  bool along_surface() const {
    return options_.orientation.method == Orientation::kMst ||
           options_.orientation.method == Orientation::kOutward;
  }
  bool aligned() const { return options_.orientation.method == Orientation::kAlign; }
  /// Do normals look to sensors that the points tell?
  bool to_sensors() const { return to_sensors_; }

  void read_index() {
    PlaceSample sample(std::max({kNoiseSample, kScanLineSample, kPixelSample}));
    ProgressStage progress("reading " + (name_.empty() ? "points" : name_), cloud_.size(),
                           "points");
    const std::size_t length = index_length();
    bool all_told = true;
    for (std::size_t begin = 0; begin < cloud_.size(); begin += length) {
      const std::size_t end = std::min(begin + length, cloud_.size());
      const bool all_columns = begin == 0 || sensors_ || aligned();
      SurfelCloud piece = all_columns ? cloud_.read(begin, end) : SurfelCloud();
      if (!all_columns) piece.position = cloud_.positions(begin, end);
      if (begin == 0) {
        column_bytes_ = row_bytes(piece);
        told_once_ = piece.viewpoint.has_value();
        sensors_ = !piece.scan_viewpoints.empty();
        sensor_ = options_.normals.sensor.value_or(Vec3d(0, 0, 0)) - piece.origin;
      }
      if (sensors_ && all_told) all_told = !piece.sensors().empty();
      index_.add(piece.position);
      if (aligned()) {
        without_normal_ +=
            piece.normal.empty()
                ? count_where(piece.size(),
                              [&](std::size_t i) { return piece.position[i].allFinite(); })
                : count_where(piece.size(), [&](std::size_t i) {
                    return piece.position[i].allFinite() && !usable_normal(piece.normal[i]);
                  });
      }
      std::erase_if(piece.position, [](const Vec3f& p) { return !p.allFinite(); });
      at_sensor_ =
          at_sensor_ || std::any_of(piece.position.begin(), piece.position.end(),
                                    [&](const Vec3f& p) { return p.cast<double>() == sensor_; });
      sample.add(piece.position);
      progress.add(end - begin);
    }
    index_.finish();
    sensors_ = sensors_ && all_told;
    if (index_.finite() == 0) {
      throw_input(name_, "there is no point with finite coordinates; export the points again");
    }
    // Any order will do by which what is near in the file is near in space.
    if (index_.median_meeting() > std::max(kMostMeeting, index_.size() / 4)) refuse_disorder(name_);
    sample_ = sample.places();
  }

  std::size_t index_length() const { return kIndexPiece / kRunLength * index_.length(); }

  /// Decides what holds for the whole cloud.
  void decide() {
    const OrientationOptions& orientation = options_.orientation;
    const bool told = told_once_ || sensors_;
    if (orientation.method == Orientation::kViewpoint && !orientation.viewpoint && !told) {
      throw_usage((name_.empty() ? "the cloud" : name_) +
                  " does not say where its scanner stood; give the `viewpoint`");
    }
    require_no_problems(block_problems(options_));
    if (aligned() && without_normal_ > 0) {
      throw_input(name_, fmt::format("{} of {} points have no normal to be aligned with: their "
                                     "side follows the others', which only works in memory; orient "
                                     "by another method, such as up or viewpoint, or give more "
                                     "memory",
                                     without_normal_, index_.finite()));
    }
    winding_ = orientation.method == Orientation::kWinding ||
               (orientation.method == Orientation::kAuto && !orientation.viewpoint && !told);
    if (winding_ && peers_) {
      throw_usage(
          "sides by winding are found by one process alone: orient by up, viewpoint, align "
          "or none, or start one process");
    }
    to_sensors_ =
        !winding_ && !orientation.viewpoint &&
        (orientation.method == Orientation::kViewpoint || orientation.method == Orientation::kAuto);
    RunSearch search(cloud_, index_);
    const auto nearest = [&](const Vec3f& place, std::size_t k, std::vector<Vec3f>& out) {
      search.nearest(place, k, out);
    };
    const auto first = [&](std::size_t most) {
      return std::span<const Vec3f>(sample_).first(std::min(most, sample_.size()));
    };
    if (grow_in_noise_ && planes_often_uncertain(index_.finite(), first(kNoiseSample), nearest)) {
      const auto directions = [&](const Vec3f& direction, std::size_t k, std::vector<float>& out) {
        search.nearest_directions(sensor_, direction, k, out);
      };
      const bool pixels =
          !at_sensor_ && seen_as_pixels(index_.finite(), sample_, sensor_, directions);
      if (pixels || noise_hides_surface(first(kNoiseSample), nearest)) {
        throw_input(name_, std::string(pixels ? "the points are a range image, whose"
                                              : "noise hides the surface: its") +
                               " normals can only be made with all points in memory; give more "
                               "memory, or have noise ignored (`grow_in_noise`)");
      }
    }
    scan_lines_ =
        options_.size.max_radius > 0 && consists_of_scan_lines(first(kScanLineSample), nearest);
  }

  static void require_no_problems(const std::vector<std::string>& problems) {
    if (!problems.empty()) throw_usage(fmt::format("{}", fmt::join(problems, "; ")));
  }

  void require_room_for_tiles(const BlockOptions& blocks, std::uint64_t index_bytes) const {
    const std::uint64_t needed =
        index_bytes + StoredSides::bytes(index_.finite(), options_.orientation.tile_points);
    if (blocks.most_points == 0 && blocks.memory < needed) {
      throw_usage(
          fmt::format("{} bytes of memory are too few to find the sides of {} points by "
                      "winding: give at least {} bytes, or orient by another method",
                      blocks.memory, index_.finite(), needed));
    }
  }

  /// Finds the side of every point by the winding number, in a pass of its own over all blocks.
  void find_sides() {
    RunSearch search(cloud_, index_);
    sides_.emplace(
        index_, options_.orientation.tile_points, sample_,
        [&](const Vec3f& place, std::size_t k, std::vector<Vec3f>& out) {
          search.nearest(place, k, out);
        },
        beside_);
    ProgressStage progress("finding sides", index_.points(), "points");
    begin_pass(Pass::kNormals);
    for_each_block([&](std::size_t begin, std::size_t end) {
      const CloudBlock block = estimate(begin, end);
      sides_->add(block.cloud.position, block.estimates.normals.normal);
      progress.add(index_.begin(end) - index_.begin(begin));
    });
    begin_pass(Pass::kSurfels);
    sides_->finish();
  }

  /// Says what blocks are for, and makes the loader of their halos.
  void begin_pass(Pass pass) {
    pass_ = pass;
    const NormalOptions& normals = options_.normals;
    HaloOptions halo{.most_points = most_loaded_};
    if (pass == Pass::kJoins) {
      halo.neighbors = kJoinNeighbors;
    } else if (normals.radius > 0) {
      halo.neighbors = 0;
      halo.radius = normals.radius;
    } else {
      halo.neighbors = normals.adaptive ? normals.k_max : normals.k;
    }
    if (pass == Pass::kSurfels && (aligned() || to_sensors_ || winding_)) {
      halo.directions = [this](const SurfelCloud& piece, std::size_t run) {
        return directions(piece, run);
      };
    }
    halos_.emplace(cloud_, index_, std::move(halo), name_);
  }

  /// Finds the side of every point along the edges between points, in a pass of its own over all
  /// blocks, and one more over the points around which parts may be joined. Process 0 does it, but
  /// for the blocks' edges, and tells the others.
  void find_sides_along_surface() {
    if (!peers_ || peers_->rank() == 0) {
      forest_.emplace(index_.finite(), grid_,
                      ForestSides::Options{.method = options_.orientation.method,
                                           .memory = forest_memory_,
                                           .of_memory = of_memory_,
                                           .beside = beside_});
    }
    begin_pass(Pass::kEdges);
    make_forests();
    if (forest_) {
      forest_->unite();
      if (forest_->looks_for_joins()) join_parts();
      along_surface_ = forest_->turn();
      forest_.reset();
    }
    if (peers_) share_turned();
    begin_pass(Pass::kSurfels);
  }

  /// Makes the forests of blocks, one in each process at a time, for process 0.
  void make_forests() {
    const int processes = peers_ ? peers_->count() : 1;
    const auto rank = static_cast<std::size_t>(peers_ ? peers_->rank() : 0);
    ProgressStage progress("finding sides", index_.points(), "points");
    const std::size_t together = block_runs_ * static_cast<std::size_t>(processes);
    for (std::size_t first = 0; first < index_.size(); first += together) {
      const std::size_t begin = std::min(first + rank * block_runs_, index_.size());
      BlockForest mine;
      if (begin < index_.size()) {
        const CloudBlock block = estimate(begin, std::min(begin + block_runs_, index_.size()));
        mine = BlockForest::of(block.cloud.position, block.estimates.normals.normal, block.edges,
                               index_.finite_before(begin), grid_);
      }
      if (forest_) forest_->add(mine);
      // Process 0 has room for one at a time.
      for (int sender = 1; sender < processes; ++sender) {
        std::vector<Bytes> to(static_cast<std::size_t>(processes));
        if (peers_->rank() == sender && begin < index_.size()) to[0] = mine.bytes();
        const std::vector<Bytes> from = peers_->exchange(std::move(to));
        const Bytes& sent = from[static_cast<std::size_t>(sender)];
        if (forest_ && !sent.empty()) forest_->add(BlockForest::of(sent));
      }
      progress.add(index_.begin(std::min(first + together, index_.size())) - index_.begin(first));
    }
  }

  /// Tells all processes what process 0 has found.
  void share_turned() {
    Bytes bytes;
    if (peers_->rank() == 0) {
      const std::uint64_t parts = along_surface_.parts;
      append_values(&parts, 1, bytes);
      append_values(along_surface_.turned.data(), along_surface_.turned.size(), bytes);
    }
    const std::vector<Bytes> from =
        peers_->exchange(std::vector<Bytes>(static_cast<std::size_t>(peers_->count()), bytes));
    const std::vector<std::uint64_t> told = values_of<std::uint64_t>(from[0]);
    along_surface_.parts = told[0];
    along_surface_.turned.assign(told.begin() + 1, told.end());
  }

  void join_parts() {
    begin_pass(Pass::kJoins);
    joins_.emplace(forest_->joins());
    ProgressStage progress("joining parts", index_.points(), "points");
    for_each_block([&](std::size_t begin, std::size_t end) {
      estimate(begin, end);
      progress.add(index_.begin(end) - index_.begin(begin));
    });
    forest_->join(*joins_);
    joins_.reset();
  }

  template <class Body>
  void for_each_block(const Body& body) const {
    for (std::size_t begin = 0; begin < index_.size(); begin += block_runs_) {
      body(begin, std::min(begin + block_runs_, index_.size()));
    }
  }

  /// Are ellipses worth it in some runs, spread evenly?
  bool guess_ellipses() {
    Totals totals;
    std::size_t points = 0;
    const std::size_t probes = std::min(kProbes, index_.size());
    for (std::size_t p = 0; p < probes; ++p) {
      const std::size_t run = p * index_.size() / probes;
      const CloudBlock block = estimate(run, run + 1);
      count(block, totals);
      points += block.cloud.size();
    }
    return worth_ellipses(totals.elongated, points);
  }

  /// The directions that orient_normals(), or turn_to_sides(), needs of the points from a run on.
  Array<Vec3f> directions(const SurfelCloud& piece, std::size_t run) const {
    if (pass_ != Pass::kSurfels) return {};
    if (winding_) return sides_->of(piece.position, run);
    if (aligned()) return piece.normal;
    if (!to_sensors_) return {};
    Array<Vec3d> sensors;
    if (sensors_) sensors = piece.sensors();
    Array<Vec3f> out(piece.size());
    for (std::size_t i = 0; i < out.size(); ++i) {
      const Vec3d& sensor = sensors_ ? sensors[i] : piece.viewpoint->position;
      out[i] = direction_to_sensor(sensor, piece.origin, piece.position[i]);
    }
    return out;
  }

  CloudBlock read_block(std::size_t begin_run, std::size_t end_run) const {
    CloudBlock block;
    block.begin_run = begin_run;
    block.end_run = end_run;
    block.run_points.push_back(0);
    for (std::size_t run = begin_run; run < end_run; ++run) {
      block.run_points.push_back(block.run_points.back() + index_[run].finite);
    }
    SurfelCloud all;
    if (pass_ == Pass::kSurfels) {
      all = cloud_.read(index_.begin(begin_run), index_.begin(end_run));
    } else {
      all.position = cloud_.positions(index_.begin(begin_run), index_.begin(end_run));
    }
    Array<std::uint32_t> finite(all.size());
    std::size_t count = 0;
    for (std::uint32_t i = 0; i < all.size(); ++i) {
      if (all.position[i].allFinite()) finite[count++] = i;
    }
    finite.resize(count);
    const Array<Vec3f> previous = directions(all, begin_run);
    if (!previous.empty()) {
      block.previous.resize(count);
      for (std::size_t i = 0; i < count; ++i) block.previous[i] = previous[finite[i]];
    }
    if (count == all.size()) {
      all.tree = {};  // As gathered() does.
      block.cloud = std::move(all);
    } else {
      block.cloud = all.gathered(finite);
    }
    make_room(block);
    return block;
  }

  /// Makes room for the estimates of a block's points.
  void make_room(CloudBlock& block) const {
    const std::size_t count = block.cloud.size();
    block.reach.resize(count);
    if (pass_ == Pass::kJoins) return;
    block.estimates.normals.normal.resize(count);
    if (pass_ == Pass::kEdges) {
      block.edges.resize(count, std::min(kOrientationNeighbors + 1, index_.finite()));
    }
    if (pass_ != Pass::kSurfels) return;
    block.estimates.normals.quality.resize(count);
    block.estimates.sizes.of.resize(count);
    block.estimates.sizes.kind.resize(count);
    block.estimates.sizes.ellipses = ellipses_;
    if (options_.orientation.method != Orientation::kNone) {
      block.estimates.side_confidence.resize(count);
    }
    block.turned.resize(count);
  }

  /// A surfel with all columns that the result will have.
  SurfelCloud first_surfel() const {
    CloudBlock block;
    block.cloud = cloud_.read(0, 1);
    block.cloud.tree = {};
    make_room(block);
    return surfels(block);
  }

  CloudBlock estimate(std::size_t begin_run, std::size_t end_run) {
    CloudBlock block = read_block(begin_run, end_run);
    std::vector<HaloTask> tasks(1);
    tasks[0].points = morton_order(block.cloud.position, grid_);
    if (tasks[0].points.empty()) return block;
    halos_->measure_reach(tasks[0].points, block);
    if (pass_ == Pass::kJoins) leave_coming(begin_run, tasks[0].points);
    if (tasks[0].points.empty()) return block;
    while (!tasks.empty()) {
      const HaloTask task = std::move(tasks.back());
      tasks.pop_back();
      const std::optional<HaloPoints> loaded = halos_->load(task, block);
      if (!loaded) {
        // Halves along the curve need fewer points each.
        const std::size_t half = task.points.size() / 2;
        const auto middle = task.points.begin() + static_cast<std::ptrdiff_t>(half);
        tasks.push_back({Array<std::uint32_t>(middle, task.points.end()), task.needed});
        tasks.push_back({Array<std::uint32_t>(task.points.begin(), middle), task.needed});
        continue;
      }
      HaloTask rest = estimate(*loaded, block);
      if (rest.points.empty()) continue;
      rest.needed.insert(rest.needed.end(), task.needed.begin(), task.needed.end());
      tasks.push_back(std::move(rest));
    }
    return block;
  }

  /// Leaves the points of a block around which parts may be joined.
  void leave_coming(std::size_t begin_run, Array<std::uint32_t>& points) const {
    Array<std::uint64_t> numbers(points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      numbers[i] = index_.finite_before(begin_run) + points[i];
    }
    const ForestSides::Parts parts = forest_->parts_of(numbers);
    std::size_t left = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (forest_->comes(parts, i)) points[left++] = points[i];
    }
    points.resize(left);
  }

  /// Looks for edges from the wanted points that are loaded to other parts. Returns the points that
  /// are not certain, with the regions that they need.
  HaloTask look_for_joins(const HaloPoints& loaded, const Array<std::uint8_t>& wanted,
                          const CloudBlock& block) {
    const ExactSearch tree(loaded.position);
    const HaloSearch search(tree, loaded.position, loaded.known, index_.finite(), wanted);
    const ForestSides::Parts parts = forest_->parts_of(loaded.number);
    find_joins(
        {loaded.position, parts.normal, parts.part, parts.opposed, loaded.number}, search,
        [&](std::size_t i) { return wanted[i] != 0; },
        [&](std::size_t i) { return search.certain(i); }, *joins_);
    return uncertain(loaded, search, wanted, block);
  }

  /// Notes the edges of the wanted points that are certain.
  void note_edges(const HaloPoints& loaded, const HaloSearch& search,
                  const Array<std::uint8_t>& wanted, const Array<Vec3f>& normal,
                  BlockEdges& out) const {
    const SurfaceEdges edges(loaded.position, normal);
    const auto note = [&](std::size_t i, std::span<const Neighbor> near, int) {
      if (wanted[i] == 0 || !search.certain(i) || !edges.known(i)) return;
      for (std::size_t k = 0; k < near.size(); ++k) {
        const std::uint32_t j = near[k].index;
        if (j == i || !edges.known(j)) continue;
        out.set(loaded.point[i], k, loaded.number[j], edges.weight(i, j), edges.opposed(i, j));
      }
    };
    search.for_each_nearest(kOrientationNeighbors + 1, note);
  }

  /// Estimates the points that are loaded, and notes the block's points that are certain. Returns
  /// the others, with the regions that they need.
  HaloTask estimate(const HaloPoints& loaded, CloudBlock& block) {
    const Array<Vec3f>& position = loaded.position;
    const std::size_t count = loaded.size();
    Array<std::uint8_t> wanted(count);
    parallel_each(count, kLoadGrain,
                  [&](std::size_t i) { wanted[i] = loaded.point[i] != kHalo ? 1 : 0; });
    if (pass_ == Pass::kJoins) return look_for_joins(loaded, wanted, block);
    const ExactSearch tree(position);
    const NeighborLists lists(tree, position, shared_);
    HaloSearch search(lists, position, loaded.known, index_.finite(), wanted);

    NormalEstimate normals = estimate_normals(position, search, options_.normals);
    PointEstimates& out = block.estimates;
    const auto note = [&](const auto& keep) {
      parallel_each(count, kLoadGrain, [&](std::size_t i) {
        if (wanted[i] != 0 && search.certain(i)) keep(i, loaded.point[i]);
      });
      return uncertain(loaded, search, wanted, block);
    };
    if (pass_ == Pass::kEdges) {
      search.next_stage();
      note_edges(loaded, search, wanted, normals.normal, block.edges);
    }
    if (pass_ != Pass::kSurfels) {
      return note(
          [&](std::size_t i, std::size_t to) { out.normals.normal[to] = normals.normal[i]; });
    }
    search.next_stage();
    Array<std::uint8_t> negative(count);
    parallel_each(count, kLoadGrain, [&](std::size_t i) {
      negative[i] = std::signbit(normals.normal[i].x()) ? 1 : 0;
    });
    Array<float> confidence;
    if (winding_) {
      turn_to_sides(position, search, loaded.previous, normals.normal, &confidence);
      totals_.method = Orientation::kWinding;
      block.components = sides_->parts();
    } else if (along_surface()) {
      Array<std::uint8_t> turned(count);
      parallel_each(count, kLoadGrain,
                    [&](std::size_t i) { turned[i] = along_surface_[loaded.number[i]] ? 1 : 0; });
      turn_known(position, search, turned, normals.normal, &confidence);
      totals_.method = options_.orientation.method;
      block.components = along_surface_.parts;
    } else {
      const OrientationReport sides =
          orient_normals(position, block.cloud.origin, search, loaded.previous,
                         options_.orientation, normals.normal, &confidence);
      totals_.method = sides.method;
      block.components = std::max(block.components, sides.components);
    }
    const bool oriented = options_.orientation.method != Orientation::kNone;
    const auto sized = [&] { search.next_stage(); };
    const SplatSizes sizes = estimate_splat_sizes(position, normals.normal, oriented, search,
                                                  options_.size, {wanted, scan_lines_, sized});

    return note([&](std::size_t i, std::size_t to) {
      out.normals.normal[to] = normals.normal[i];
      out.normals.quality[to] = normals.quality[i];
      if (!confidence.empty()) out.side_confidence[to] = confidence[i];
      out.sizes.of[to] = sizes.of[i];
      out.sizes.kind[to] = sizes.kind[i];
      const bool known = !normals.normal[i].isZero(0);
      block.turned[to] =
          known && (std::signbit(normals.normal[i].x()) ? 1 : 0) != negative[i] ? 1 : 0;
    });
  }

  /// The wanted points that are not certain, with what they need.
  HaloTask uncertain(const HaloPoints& loaded, const HaloSearch& search,
                     const Array<std::uint8_t>& wanted, const CloudBlock& block) const {
    HaloTask rest;
    for (std::size_t i = 0; i < loaded.size(); ++i) {
      if (wanted[i] != 0 && !search.certain(i)) rest.points.push_back(loaded.point[i]);
    }
    if (!rest.points.empty()) rest.needed = needed_regions(loaded, search, rest, block);
    return rest;
  }

  /// What has to be loaded for the uncertain points to become certain.
  std::vector<HaloRegion> needed_regions(const HaloPoints& loaded, const HaloSearch& search,
                                         const HaloTask& uncertain, const CloudBlock& block) const {
    constexpr float kRounding = 1 + 1e-4F;
    // A neighbourhood among the points that are known may hold far too much if it reaches further
    // than halos do: where it ends is then found in the whole cloud.
    float usual = 0;
    for (const std::uint32_t i : uncertain.points) usual = std::max(usual, block.reach[i]);
    RunSearch exact(cloud_, index_);
    std::vector<Vec3f> near;
    std::vector<HaloRegion> out;
    for (const HaloSearch::Missing& missing : search.missing()) {
      const Vec3f& p = loaded.position[missing.point];
      float reach = missing.reach;
      if (!(reach <= usual)) {
        exact.nearest(p, missing.most, near);
        reach = std::min(reach, (near.back() - p).norm());
      }
      out.push_back({{p, p}, kRounding * reach + std::numeric_limits<float>::min()});
    }
    return out;
  }

  void count(const CloudBlock& block, Totals& totals) const {
    const NormalOptions& o = options_.normals;
    // Neighbourhoods of more points than were searched for were enlarged.
    const std::size_t searched =
        o.radius > 0
            ? std::numeric_limits<std::size_t>::max()
            : std::min(static_cast<std::size_t>(o.adaptive ? o.k_max : o.k), index_.finite());
    const PointEstimates& e = block.estimates;
    for (std::size_t i = 0; i < block.cloud.size(); ++i) {
      const NormalQuality& quality = e.normals.quality[i];
      ++totals.flagged[static_cast<std::size_t>(quality.flag)];
      totals.neighbors += quality.neighbors;
      totals.extended += quality.neighbors > searched ? 1 : 0;
      totals.flipped += block.turned[i];
      totals.unknown += e.normals.normal[i].isZero(0) ? 1 : 0;
      const CellKind kind = e.sizes.kind[i];
      totals.border += kind != CellKind::kClosed ? 1 : 0;
      totals.capped += kind == CellKind::kAlone ? 1 : 0;
      totals.elongated += elongated(e.sizes.of[i], kind) ? 1 : 0;
    }
    totals.confidence += sum_of_confidences(e.side_confidence);
    totals.unusable_colors += unusable_colors(block.cloud);
    totals.components = std::max(totals.components, block.components);
  }

  /// The surfels of a block that has been estimated.
  static SurfelCloud surfels(CloudBlock& block) {
    SurfelCloud out = std::move(block.cloud);
    Array<std::uint32_t> place(out.size());
    std::iota(place.begin(), place.end(), 0U);
    set_estimates(block.estimates, place, out);
    return out;
  }

  void fill(EstimateReport& r) const {
    r.points = index_.points();
    r.nonfinite = index_.points() - index_.finite();
    r.unusable_colors = totals_.unusable_colors;
    r.flagged = totals_.flagged;
    r.extended = totals_.extended;
    r.mean_neighbors =
        static_cast<double>(totals_.neighbors) / static_cast<double>(index_.finite());
    r.orientation.method = totals_.method;
    r.orientation.components = totals_.components;
    r.orientation.flipped = totals_.flipped;
    r.orientation.unknown = totals_.unknown;
    if (options_.orientation.method != Orientation::kNone) {
      r.side_confidence = mean_confidence(totals_.confidence, index_.finite());
    }
    r.border = totals_.border;
    r.capped = totals_.capped;
    r.anisotropic = ellipses_;
  }

  const SurfelRanges& cloud_;
  EstimateOptions options_;
  const std::string& name_;
  MortonGrid grid_;
  Checkpoints* checkpoints_;
  Peers* peers_;
  std::string beside_;
  RunIndex index_;
  std::optional<HaloLoader> halos_;  ///< Once it is decided what the points need.
  std::vector<Vec3f> sample_;
  std::size_t shared_ = 0;        ///< Neighbours that are kept for all stages.
  std::size_t column_bytes_ = 0;  ///< Bytes of a point's columns.
  std::size_t block_runs_ = 0;    ///< Runs of a block.
  std::size_t without_normal_ = 0;
  bool told_once_ = false;   ///< The cloud tells a viewpoint for all points.
  bool sensors_ = false;     ///< Each point tells its sensor.
  bool to_sensors_ = false;  ///< Normals look to what the cloud tells.
  bool winding_ = false;     ///< Sides are told by the winding number: find_sides().
  std::optional<StoredSides> sides_;
  std::optional<ForestSides> forest_;  ///< While sides along the surface are found.
  TurnedPoints along_surface_;         ///< What has been found.
  std::optional<PartJoins> joins_;     ///< In the pass that looks for them.
  std::size_t most_loaded_ = 0;        ///< Points that memory holds at once.
  std::uint64_t forest_memory_ = 0;    ///< Bytes for forest_.
  std::uint64_t of_memory_ = 0;        ///< Bytes for all.
  Pass pass_ = Pass::kSurfels;
  bool grow_in_noise_ = false;
  Vec3d sensor_{0, 0, 0};   ///< Where the points may have been seen from.
  bool at_sensor_ = false;  ///< A point is there.
  bool scan_lines_ = false;
  bool ellipses_ = false;
  Totals totals_;
};

}  // namespace

std::vector<std::string> block_problems(const EstimateOptions& options) {
  std::vector<std::string> found;
  const auto refuse = [&](bool asked_for, const char* what) {
    if (asked_for) {
      found.push_back(std::string(what) +
                      " cannot be done block by block: all points have to fit into memory for it");
    }
  };
  refuse(options.outliers.has_value(), "removal of `outliers`");
  refuse(options.voxels.has_value(), "averaging in `voxels`");
  refuse(options.smoothing.has_value(), "`smoothing`");
  refuse(options.edges.has_value(), "looking for `edges`");
  refuse(options.search != SearchMethod::kExact, "a `search` other than exact");
  return found;
}

std::uint64_t estimate_bytes(std::size_t points, std::size_t point_bytes) {
  // The cloud, and the surfels with their normals, sizes and properties, are in memory at once.
  constexpr std::uint64_t kSurfelBytes = 40;
  return points * std::uint64_t{250 + kSurfelBytes + 2 * point_bytes};
}

void estimate_by_blocks(const SurfelRanges& cloud, const EstimateOptions& options,
                        const BlockOptions& blocks, SurfelSink& sink, EstimateReport* report,
                        const std::string& name) {
  require_usable(options);
  EstimateReport r;
  StageTimer stage(r.times);
  // Processes that had different blocks would leave some out.
  BlockOptions agreed = blocks;
  agreed.memory = least_of(blocks.peers, blocks.memory);
  BlockEstimator(cloud, options, agreed, name).run(sink, r, stage);
  if (report) *report = std::move(r);
}

}  // namespace surfel
