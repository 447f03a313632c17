#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>
#include <type_traits>
#include <vector>

#include <surfel/base/parallel.h>
#include <surfel/io/cloud_survey.h>
#include <surfel/io/cloud_to_records.h>
#include <surfel/io/file_kind.h>
#include <surfel/scene/exact_coordinates.h>

namespace surfel {
namespace {

constexpr std::size_t kSurveyBlock = 4096;

void merge(CloudSurvey::Range& range, const CloudSurvey::Range& other) {
  range.least = std::min(range.least, other.least);
  range.most = std::max(range.most, other.most);
  range.count += other.count;
  range.fractions += other.fractions;
  range.nan += other.nan;
  range.infinite += other.infinite;
  range.outside += other.outside;
}

template <class T>
void add_value(CloudSurvey::Range& range, T stored) {
  const auto value = static_cast<double>(stored);
  ++range.count;
  range.outside += value < 0 || value > std::numeric_limits<std::uint16_t>::max() ? 1 : 0;
  if (std::is_integral_v<T> || std::isfinite(value)) {
    range.least = std::min(range.least, value);
    range.most = std::max(range.most, value);
    range.fractions += std::is_integral_v<T> || value == std::trunc(value) ? 0 : 1;
  } else {
    ++(std::isnan(value) ? range.nan : range.infinite);
  }
}

bool is_placed_apart(std::string_view name) {
  constexpr std::array<std::string_view, 6> kNames{"x", "y", "z", "red", "green", "blue"};
  return std::find(kNames.begin(), kNames.end(), name) != kNames.end();
}

/// The rows of the least and the largest finite coordinates; none where no position is finite.
Array<std::uint32_t> outermost_rows(const SurfelCloud& cloud) {
  std::array<std::optional<std::uint32_t>, 6> found;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    if (!cloud.position[i].allFinite()) continue;
    for (int axis = 0; axis < 3; ++axis) {
      const auto less = [&](std::uint32_t a, std::uint32_t b) {
        const float x = cloud.position[a][axis];
        const float y = cloud.position[b][axis];
        return x == y ? cloud.world(a, axis) < cloud.world(b, axis) : x < y;
      };
      std::optional<std::uint32_t>& least = found[2 * axis];
      std::optional<std::uint32_t>& most = found[2 * axis + 1];
      if (!least || less(i, *least)) least = i;
      if (!most || less(*most, i)) most = i;
    }
  }
  Array<std::uint32_t> rows;
  for (const auto& row : found) {
    if (row) rows.push_back(*row);
  }
  return rows;
}

}  // namespace

CloudSurvey::CloudSurvey(const std::string& path) : with_ranges_(is_las_name(path)) {}

void CloudSurvey::add(const SurfelCloud& piece) {
  const SurfelCloud outermost = piece.gathered(outermost_rows(piece));
  const ExactCoordinates coordinates(outermost);
  for (std::size_t i = 0; i < outermost.size(); ++i) box.add(coordinates(i));
  spread_.add(piece.origin, piece.position);
  if (!nowhere) {
    const auto first = std::find_if(piece.position.begin(), piece.position.end(),
                                    [](const Vec3f& position) { return !position.allFinite(); });
    if (first != piece.position.end()) {
      nowhere = count + static_cast<std::uint64_t>(first - piece.position.begin());
    }
  }
  if (count == 0) decimals = piece.decimals;
  decimals = decimals && piece.decimals ? std::optional(std::max(*decimals, *piece.decimals))
                                        : std::nullopt;
  count += piece.size();
  exact = exact || !piece.exact.empty();
  if (with_ranges_) {
    add_ranges(piece);
  } else if (float_positions) {
    const CloudRecords records(piece, {});
    float_positions = records.columns().front().type == ScalarType::kFloat32;
  }
}

void CloudSurvey::settle(SurfelCloud& piece) const {
  piece.double_positions = piece.double_positions || !float_positions;
}

void CloudSurvey::add_ranges(const SurfelCloud& piece) {
  const CloudRecords records(piece, {.double_positions = true});
  std::vector<RecordColumn> columns;
  for (const RecordColumn& column : records.columns()) {
    if (!is_placed_apart(column.name)) columns.push_back(column);
  }
  PerWorker<std::vector<Range>> ranges;
  PerWorker<Array<std::byte>> buffers;
  parallel_for(piece.size(), kSurveyBlock, [&](std::size_t begin, std::size_t end, int worker) {
    std::vector<Range>& part = ranges[worker];
    part.resize(columns.size());
    Array<std::byte>& bytes = buffers[worker];
    bytes.resize(kSurveyBlock * records.stride());
    records.encode(begin, end, bytes.data());
    for (std::size_t k = 0; k < columns.size(); ++k) {
      visit_type(columns[k].type, [&]<class T>(T) {
        const std::byte* at = bytes.data() + columns[k].offset;
        for (std::size_t i = begin; i < end; ++i, at += records.stride()) {
          add_value(part[k], load_scalar<T, false>(at));
        }
      });
    }
  });
  for (std::size_t k = 0; k < columns.size(); ++k) {
    Range& all = range[columns[k].name];
    ranges.for_each([&](const std::vector<Range>& seen) {
      if (!seen.empty()) merge(all, seen[k]);
    });
  }
}

}  // namespace surfel
