#include <algorithm>
#include <cstring>

#include <surfel/scene/cloud_rows.h>
#include <surfel/scene/column_pairs.h>

namespace surfel {

std::size_t row_bytes(const SurfelCloud& cloud) {
  std::size_t bytes = 0;
  SurfelCloud::visit_columns(cloud, [&](const auto& column) {
    if (!column.empty()) bytes += sizeof(column.front());
  });
  for (const ExtraProperty& property : cloud.extra) bytes += scalar_size(property.type);
  return bytes;
}

SurfelCloud cloud_of_rows(const SurfelCloud& like, std::size_t rows) {
  SurfelCloud cloud = like.gathered({});
  visit_column_pairs(like, cloud, [&](const auto& from, auto& to) {
    if (!from.empty()) to.resize(rows);
  });
  for (ExtraProperty& property : cloud.extra) {
    property.data.resize(rows * scalar_size(property.type));
  }
  return cloud;
}

void copy_rows(const SurfelCloud& from, std::size_t begin, std::size_t end, SurfelCloud& to,
               std::size_t at) {
  if (begin == end) return;
  visit_column_pairs(from, to, [&](const auto& column, auto& copy) {
    if (column.empty()) return;
    std::copy(column.begin() + static_cast<std::ptrdiff_t>(begin),
              column.begin() + static_cast<std::ptrdiff_t>(end),
              copy.begin() + static_cast<std::ptrdiff_t>(at));
  });
  for (std::size_t k = 0; k < from.extra.size(); ++k) {
    const std::size_t bytes = scalar_size(from.extra[k].type);
    std::memcpy(to.extra[k].data.data() + at * bytes, from.extra[k].data.data() + begin * bytes,
                (end - begin) * bytes);
  }
}

}  // namespace surfel
