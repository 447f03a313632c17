#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <surfel/io/surfel_decoder.h>
#include <surfel/store/surfel_source.h>

namespace surfel {

/// Surfels in a file's records, decoded without a SurfelCloud in between. Records are read block by
/// block, so that a file of any size costs no memory.
class RecordSource : public SurfelSource {
 public:
  /// Throws Error(kInput) naming `file` if a coordinate is missing, if variance and radius are both
  /// missing, or if there are no records. Keeps a reference to the table.
  /// \param bounds  World bounds of the positions, if they are known. If not, positions of another
  ///                type than float are read once to find their bounds.
  RecordSource(const RecordTable& table, const std::string& file,
               const std::optional<Bounds>& bounds = {});
  RecordSource(RecordTable&& table, const std::string& file,
               const std::optional<Bounds>& bounds = {}) = delete;

  std::size_t size() const override { return table_.count; }
  SurfelAttributes attributes() const override;
  Vec3d origin() const override { return decoder_.origin(); }
  bool recenter(const Bounds& bounds) override;
  void fill(std::size_t begin, std::size_t end, RenderCloud& cloud, std::size_t row) const override;
  void fill_sources(std::size_t begin, std::size_t end, std::uint32_t* to) const override;
  std::vector<std::string> columns() const override;
  void fill_column(std::size_t column, std::size_t begin, std::size_t end,
                   double* to) const override;
  void expect(std::size_t begin, std::size_t end) const override;

 private:
  /// The part of the box that the origin should suit.
  Bounds measure() const;
  const std::byte* read(std::size_t begin, std::size_t end) const;
  void decode(const std::byte* records, std::size_t count, RenderCloud& cloud,
              std::size_t row) const;

  const RecordTable& table_;
  SurfelDecoder decoder_;
};

}  // namespace surfel
