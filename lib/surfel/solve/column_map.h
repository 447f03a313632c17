#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace surfel {

/// Numbers columns of a sparse matrix in the order in which they first come: an open-addressing
/// hash table with linear probing (Knuth, "The Art of Computer Programming" 3, 6.4). Its memory
/// follows the number of columns it has held at once, not their values, so that every worker of a
/// loop may have one however many unknowns there are.
class ColumnMap {
 public:
  static constexpr std::uint32_t kAbsent = static_cast<std::uint32_t>(-1);

  ColumnMap() : slots_(kLeastSlots) {}

  /// The column's number; kAbsent where it has none.
  std::uint32_t find(std::uint32_t column) const { return slots_[slot_of(column)].number; }

  /// The column's number; a new column gets the next one, size().
  std::uint32_t number(std::uint32_t column) {
    std::size_t slot = slot_of(column);
    if (slots_[slot].number != kAbsent) return slots_[slot].number;
    if (kSlotsPerColumn * (columns_.size() + 1) > slots_.size()) {
      grow();
      slot = slot_of(column);
    }
    slots_[slot] = {column, static_cast<std::uint32_t>(columns_.size())};
    columns_.push_back(column);
    return slots_[slot].number;
  }

  /// The columns in the order of their numbers.
  const std::vector<std::uint32_t>& columns() const { return columns_; }
  std::size_t size() const { return columns_.size(); }
  std::size_t bytes() const {
    return slots_.capacity() * sizeof(Slot) + columns_.capacity() * sizeof(std::uint32_t);
  }

  /// Forgets all columns and keeps the memory.
  void clear() {
    // Last comes first: probing for a column passes columns that came before it.
    for (; !columns_.empty(); columns_.pop_back()) slots_[slot_of(columns_.back())] = Slot();
  }

 private:
  struct Slot {
    std::uint32_t column = 0;
    std::uint32_t number = kAbsent;
  };
  static constexpr std::size_t kLeastSlots = 256;    ///< A power of two; most rows need no more.
  static constexpr std::size_t kSlotsPerColumn = 2;  ///< At most half full, probing ends soon.

  /// The slot that holds the column, or else the free one where it belongs.
  std::size_t slot_of(std::uint32_t column) const {
    // Neighbours in space, which most columns of a row are, get slots that follow each other.
    std::size_t slot = column & (slots_.size() - 1);
    while (slots_[slot].column != column && slots_[slot].number != kAbsent) {
      slot = (slot + 1) & (slots_.size() - 1);
    }
    return slot;
  }
  void grow() {
    slots_.assign(2 * slots_.size(), Slot());
    for (std::uint32_t number = 0; number < columns_.size(); ++number) {
      slots_[slot_of(columns_[number])] = {columns_[number], number};
    }
  }

  std::vector<Slot> slots_;
  std::vector<std::uint32_t> columns_;
};

}  // namespace surfel
