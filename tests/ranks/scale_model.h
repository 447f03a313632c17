#pragma once

// A model of pictures that many processes make of clouds that no machine here holds: a store's real
// tree of levels of detail, repeated side by side, is cut as pictures cut it, and the messages that
// the processes send each other pass through queues with a bandwidth and a latency.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <queue>
#include <utility>
#include <vector>

#include <surfel/ranks/ranks.h>
#include <surfel/scene/camera.h>
#include <surfel/scene/cluster_tree.h>

namespace surfel::test {

/// Tiles that each are the cloud of one tree, in a square of 2^levels a side in the plane that the
/// cloud extends in. Above the tiles four neighbours make one, with as many surfels as a tile's
/// root, whose pieces are twice as long: what the levels of a surface do that goes on and on.
struct TiledCloud {
  const ClusterTree& tile;
  int levels = 0;

  std::uint64_t tiles() const { return std::uint64_t{1} << 2 * levels; }
  Vec3d size() const { return (tile.front().reach_max - tile.front().reach_min).cast<double>(); }
  /// The axis that the plane is perpendicular to.
  int up() const {
    int axis = 0;
    size().minCoeff(&axis);
    return axis;
  }
  /// The sides of a tile in the plane.
  Vec3d side() const {
    Vec3d sides = size();
    sides[up()] = 0;
    return sides;
  }
  /// A point over the middle of all tiles: `ahead` along the plane's second axis, and so high.
  Vec3d over_middle(double ahead, double high) const {
    Vec3d at = tile.front().reach_min.cast<double>() + std::ldexp(0.5, levels) * side();
    at[up()] += size()[up()] / 2 + high;
    at[(up() + 2) % 3] += ahead;
    return at;
  }
  std::uint64_t surfels() const {
    return tiles() * (tile.back().end - tile[first_leaf(tile)].begin);
  }
  std::uint64_t clusters() const { return tiles() * tile.size() + (tiles() - 1) / 3; }
};

/// The level whose subtrees are dealt to processes: of squares of tiles, or below a tile's root.
struct Dealing {
  int depth = 0;             ///< Of squares; TiledCloud::levels: tiles.
  std::size_t place = 0;     ///< Of a single tile, the place among its levels; else 0.
  std::size_t subtrees = 1;  ///< How many there are.
};

inline Dealing deal(const TiledCloud& cloud, int processes) {
  const std::size_t enough = kSubtreesEach * static_cast<std::size_t>(processes);
  if (cloud.levels == 0) {
    std::vector<std::size_t> counts;
    for (const TreeLevel& level : levels_of(cloud.tile)) counts.push_back(level.end - level.begin);
    const std::size_t place = dealt_level(counts, processes);
    return {0, place, counts[place]};
  }
  Dealing dealing;
  while (dealing.depth < cloud.levels && dealing.subtrees < enough) {
    ++dealing.depth;
    dealing.subtrees *= 4;
  }
  return dealing;
}

/// A cluster that a picture draws.
struct DrawnCluster {
  std::uint64_t subtree;  ///< Whose process draws it.
  std::uint32_t surfels;
  int first_row, end_row;  ///< Rows of pixels that it may reach into.
};

/// What a picture draws of a tiled cloud.
struct TiledCut {
  std::vector<DrawnCluster> drawn;
  std::uint64_t looked_at_above = 0;           ///< Clusters above the subtrees: all cut them.
  std::vector<std::uint64_t> looked_at_below;  ///< Clusters of each subtree.
};

/// Cuts a tiled cloud as ClusterCulling does, by spheres alone.
class TiledCutter {
 public:
  /// \param reach  how far discs go beyond their centres, in standard deviations.
  TiledCutter(const TiledCloud& cloud, const Camera& camera, double lod_error, double reach,
              const Dealing& dealing)
      : cloud_(cloud), camera_(camera), error_(lod_error), reach_(reach), dealing_(dealing) {
    cut_.looked_at_below.resize(dealing.subtrees);
    const std::vector<TreeLevel> levels = levels_of(cloud.tile);
    dealt_level_ = cloud.tile[levels[dealing.place].begin].level;
    first_dealt_ = levels[dealing.place].begin;
  }

  TiledCut cut() {
    visit_square(0, 0);
    return std::move(cut_);
  }

 private:
  struct Ball {
    Vec3d center;
    double radius, deviation, spacing;
  };
  enum class Step : std::uint8_t { kSkip, kDraw, kRefine };

  Step look(const Ball& ball, DrawnCluster& found) const {
    const Vec3d p = camera_.camera_from_world * (ball.center - camera_.eye);
    const double r = ball.radius + reach_ * ball.deviation;
    if (p.z() + r <= camera_.near) return Step::kSkip;
    // Planes through the eye and the picture's borders.
    const auto outside = [&](double at, double focal, double low, double high) {
      return focal * at - high * p.z() > r * std::hypot(focal, high) ||
             low * p.z() - focal * at > r * std::hypot(focal, low);
    };
    const double left = -camera_.center_x;
    const double top = -camera_.center_y;
    if (outside(p.x(), camera_.focal_x, left, left + camera_.width) ||
        outside(p.y(), camera_.focal_y, top, top + camera_.height)) {
      return Step::kSkip;
    }
    const double nearest = p.z() - ball.radius;
    const double focal = std::max(camera_.focal_x, camera_.focal_y);
    if (!(nearest > 0 && ball.spacing * focal <= error_ * nearest)) return Step::kRefine;
    const double y = camera_.center_y + camera_.focal_y * p.y() / p.z();
    const double rows = camera_.focal_y * r / nearest;
    const double last = camera_.height - 1;
    found.first_row = static_cast<int>(std::clamp(y - rows, 0.0, last));
    found.end_row = 1 + static_cast<int>(std::clamp(y + rows, 0.0, last));
    return Step::kDraw;
  }

  /// Where the first tile of a square lies, the number of which is a Morton code.
  Vec3d place(std::uint64_t morton, double tiles) const {
    Vec3d at(0, 0, 0);
    for (int bit = 0; bit < 60; ++bit) {
      if ((morton >> bit & 1) == 0) continue;
      at[(cloud_.up() + 1 + bit % 2) % 3] += std::ldexp(tiles, bit / 2);
    }
    return at.cwiseProduct(cloud_.side());
  }

  void count(bool above, std::uint64_t subtree) {
    ++(above ? cut_.looked_at_above : cut_.looked_at_below[subtree]);
  }

  void visit_square(int depth, std::uint64_t morton) {
    if (depth == cloud_.levels) {
      visit_tile(place(morton, 1), 0, morton >> 2 * (depth - dealing_.depth));
      return;
    }
    const bool above = depth < dealing_.depth;
    const std::uint64_t subtree =
        above ? morton << 2 * (dealing_.depth - depth) : morton >> 2 * (depth - dealing_.depth);
    count(above, subtree);
    const double tiles = std::ldexp(1.0, cloud_.levels - depth);
    const TreeCluster& root = cloud_.tile.front();
    const Ball ball{
        place(morton, tiles) + root.bounds.center.cast<double>() + (tiles - 1) / 2 * cloud_.side(),
        root.bounds.radius + (tiles - 1) / 2 * cloud_.side().norm(),
        root.bounds.max_deviation * tiles, root.spacing * tiles};
    DrawnCluster found{subtree, root.end - root.begin, 0, 0};
    const Step step = look(ball, found);
    if (step == Step::kDraw) cut_.drawn.push_back(found);
    if (step != Step::kRefine) return;
    for (std::uint64_t k = 0; k < 4; ++k) visit_square(depth + 1, morton << 2 | k);
  }

  void visit_tile(const Vec3d& offset, std::uint32_t index, std::uint64_t subtree) {
    const TreeCluster& c = cloud_.tile[index];
    const bool above = cloud_.levels == 0 && c.level > dealt_level_;
    if (cloud_.levels == 0 && c.level >= dealt_level_) {
      std::uint32_t first = index;
      while (cloud_.tile[first].level > dealt_level_) first = cloud_.tile[first].first_child;
      subtree = first - first_dealt_;
    }
    count(above, subtree);
    const Ball ball{offset + c.bounds.center.cast<double>(), c.bounds.radius,
                    c.bounds.max_deviation, c.spacing};
    DrawnCluster found{subtree, c.end - c.begin, 0, camera_.height};
    const Step step = look(ball, found);
    if (step == Step::kSkip) return;
    // The finest level is drawn however near it is, over the whole height at worst.
    if (step == Step::kDraw || c.child_count == 0) {
      cut_.drawn.push_back(found);
      return;
    }
    for (std::uint32_t k = 0; k < c.child_count; ++k) {
      visit_tile(offset, c.first_child + k, subtree);
    }
  }

  const TiledCloud& cloud_;
  const Camera& camera_;
  double error_, reach_;
  Dealing dealing_;
  std::uint8_t dealt_level_ = 0;
  std::size_t first_dealt_ = 0;
  TiledCut cut_;
};

/// A message from one process to another.
struct Message {
  int from, to;
  double bytes;
};

/// What becomes of messages.
struct Delivery {
  double seconds = 0;           ///< Until all have been received.
  double bytes = 0;             ///< Of all.
  double longest_queue = 0;     ///< Most bytes that wait for one process at a time.
  std::size_t most_queued = 0;  ///< Most messages that do.
};

/// Delivers messages over links: each process sends its messages one after another, in the order
/// given, and receives one after another what has arrived, first come, first served; what arrives
/// meanwhile waits in the switch, which has room for all.
/// \param ready  when each process begins to send, seconds.
inline Delivery deliver(const std::vector<Message>& messages, const std::vector<double>& ready,
                        double bandwidth, double latency) {
  struct Event {
    double time;
    bool arrives;  ///< Else: has been received.
    std::size_t message;
  };
  const auto later = [](const Event& a, const Event& b) {
    return a.time != b.time ? a.time > b.time : a.message > b.message;
  };
  std::priority_queue<Event, std::vector<Event>, decltype(later)> events(later);
  std::vector<double> link_free = ready;
  for (std::size_t i = 0; i < messages.size(); ++i) {
    double& free = link_free[static_cast<std::size_t>(messages[i].from)];
    events.push({free + latency, true, i});
    free += messages[i].bytes / bandwidth;
  }
  struct Receiver {
    std::queue<std::size_t> waiting;
    double queued = 0;
    bool busy = false;
  };
  std::vector<Receiver> receivers(ready.size());
  Delivery result;
  const auto receive = [&](Receiver& receiver, double now) {
    if (receiver.busy || receiver.waiting.empty()) return;
    const std::size_t next = receiver.waiting.front();
    receiver.waiting.pop();
    receiver.queued -= messages[next].bytes;
    receiver.busy = true;
    events.push({now + messages[next].bytes / bandwidth, false, next});
  };
  while (!events.empty()) {
    const Event event = events.top();
    events.pop();
    const Message& message = messages[event.message];
    Receiver& receiver = receivers[static_cast<std::size_t>(message.to)];
    if (event.arrives) {
      receiver.waiting.push(event.message);
      receiver.queued += message.bytes;
    } else {
      receiver.busy = false;
      result.bytes += message.bytes;
      result.seconds = std::max(result.seconds, event.time);
    }
    receive(receiver, event.time);
    result.longest_queue = std::max(result.longest_queue, receiver.queued);
    result.most_queued = std::max(result.most_queued, receiver.waiting.size());
  }
  return result;
}

/// Machines, and what a process of one core takes for its work.
struct Machines {
  double bandwidth = 1.25e9;  ///< Of a process's link, bytes a second each way: 10 Gbit/s.
  double latency = 20e-6;     ///< Seconds.
  double disk = 5e8;          ///< Bytes a second that a process reads.
  double look_at = 2e-7;      ///< Seconds for a cluster that is culled or refined.
  double send = 3e-7;         ///< Seconds for a surfel that is decoded, packed and taken over.
  double draw = 2e-7;         ///< Seconds for a surfel that is drawn.
  double pixel = 2e-7;        ///< Seconds for a pixel.
};

/// Bytes of what is held, sent and read.
struct Sizes {
  double record = 60;   ///< Of a surfel in the file.
  double columns = 60;  ///< Of a surfel in a message, and in memory.
  double header = 60;   ///< Of a cluster in a message.
  double held = 280;    ///< Of a cluster of the tree that a process holds.
  double flight = 512;  ///< Of a surfel that is being drawn.
  double pixel = 16;    ///< Of the picture.
};

/// A picture that processes make together.
struct SharedPicture {
  std::uint64_t drawn_clusters = 0;
  double drawn_surfels = 0;
  std::size_t messages = 0;  ///< Of surfels, between different processes.
  Delivery exchange;
  double most_sent = 0, mean_sent = 0;          ///< By one process, with what it sends itself.
  double most_received = 0, mean_received = 0;  ///< By processes that have rows.
  int drawing = 0;                              ///< Processes that have rows.
  double most_drawing_time = 0, mean_drawing_time = 0;
  double held_bytes = 0;    ///< Of the tree, by the process that holds most.
  double flight_bytes = 0;  ///< Of surfels, by the process that draws most.
  double cut_seconds = 0, read_seconds = 0, gather_seconds = 0;  ///< Of the slowest.
};

/// How subtrees are dealt.
enum class DealtBy : std::uint8_t { kTurns, kRanges };

/// A picture by so many processes, once rows have been balanced over some pictures of one view.
/// \param pictures  of that view, of which this is the last.
inline SharedPicture share_picture(const TiledCloud& cloud, const Camera& camera,
                                   const TiledCut& cut, const Dealing& dealing, int processes,
                                   const Machines& machines = {}, const Sizes& sizes = {},
                                   DealtBy by = DealtBy::kTurns, int pictures = 4) {
  const auto count = static_cast<std::size_t>(processes);
  const auto owner = [&](std::uint64_t subtree) {
    return by == DealtBy::kTurns ? static_cast<std::size_t>(dealt_to(subtree, processes))
                                 : static_cast<std::size_t>(subtree * count / dealing.subtrees);
  };
  SharedPicture picture;
  picture.drawn_clusters = cut.drawn.size();
  RowBalance balance(processes);
  std::vector<std::vector<double>> sent;
  std::vector<double> surfels;
  std::vector<double> times;
  std::vector<double> own_surfels(count);
  constexpr int kMargin = 48;  // Rows beyond its own that a process looks at.
  for (int i = 0; i < pictures; ++i) {
    const std::vector<RowRange> rows = balance.rows(camera.height);
    std::vector<std::size_t> with_rows;
    for (std::size_t r = 0; r < count; ++r) {
      if (rows[r].begin < rows[r].end) with_rows.push_back(r);
    }
    sent.assign(count, std::vector<double>(count));
    surfels.assign(count, 0);
    own_surfels.assign(count, 0);
    for (const DrawnCluster& c : cut.drawn) {
      const std::size_t from = owner(c.subtree);
      own_surfels[from] += c.surfels;
      const auto first =
          std::partition_point(with_rows.begin(), with_rows.end(),
                               [&](std::size_t r) { return rows[r].end + kMargin <= c.first_row; });
      for (auto to = first; to != with_rows.end(); ++to) {
        if (rows[*to].begin - kMargin >= c.end_row) break;
        sent[from][*to] += sizes.header + sizes.columns * c.surfels;
        surfels[*to] += c.surfels;
      }
    }
    times.assign(count, 0);
    for (const std::size_t r : with_rows) {
      const int seen =
          std::min(camera.height, rows[r].end + kMargin) - std::max(0, rows[r].begin - kMargin);
      times[r] = machines.draw * surfels[r] + machines.pixel * camera.width * seen;
    }
    picture.drawing = static_cast<int>(with_rows.size());
    if (i + 1 < pictures) balance.learn(rows, times);
  }
  picture.drawn_surfels = std::accumulate(own_surfels.begin(), own_surfels.end(), 0.0);

  std::vector<double> looked_at(count, static_cast<double>(cut.looked_at_above));
  for (std::size_t s = 0; s < cut.looked_at_below.size(); ++s) {
    looked_at[owner(s)] += static_cast<double>(cut.looked_at_below[s]);
  }
  std::vector<Message> messages;
  std::vector<double> ready(count);
  for (std::size_t from = 0; from < count; ++from) {
    const double cutting = machines.look_at * looked_at[from];
    const double reading =
        sizes.record * own_surfels[from] / machines.disk + machines.send * own_surfels[from];
    picture.cut_seconds = std::max(picture.cut_seconds, cutting);
    picture.read_seconds = std::max(picture.read_seconds, reading);
    ready[from] = cutting + reading;
    double all = 0;
    for (std::size_t step = 0; step < count; ++step) {
      const std::size_t to = (from + step) % count;
      all += sent[from][to];
      if (step > 0 && sent[from][to] > 0) {
        messages.push_back({static_cast<int>(from), static_cast<int>(to), sent[from][to]});
      }
    }
    picture.most_sent = std::max(picture.most_sent, all);
    picture.mean_sent += all / static_cast<double>(processes);
  }
  picture.messages = messages.size();
  picture.exchange = deliver(messages, ready, machines.bandwidth, machines.latency);
  for (std::size_t to = 0; to < count; ++to) {
    double all = 0;
    for (std::size_t from = 0; from < count; ++from) all += sent[from][to];
    picture.most_received = std::max(picture.most_received, all);
    picture.mean_received += all / picture.drawing;
    picture.most_drawing_time = std::max(picture.most_drawing_time, times[to]);
    picture.mean_drawing_time += times[to] / picture.drawing;
    picture.flight_bytes = std::max(picture.flight_bytes,
                                    sizes.flight * surfels[to] + sizes.columns * own_surfels[to]);
  }
  // Subtrees are alike where tiles are. The clusters above them are a third as many, and neighbours
  // that are dealt to different processes have all of these held by each.
  const double subtrees_each = std::ceil(static_cast<double>(dealing.subtrees) / processes);
  const double each = static_cast<double>(cloud.clusters()) / static_cast<double>(dealing.subtrees);
  picture.held_bytes =
      sizes.held * (subtrees_each * each + static_cast<double>(dealing.subtrees) / 3);
  picture.gather_seconds =
      sizes.pixel * camera.width * camera.height / machines.bandwidth + machines.latency;
  return picture;
}

}  // namespace surfel::test
