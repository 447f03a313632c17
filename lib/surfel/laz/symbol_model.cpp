#include <algorithm>

#include <surfel/laz/symbol_model.h>

namespace surfel::laz {
namespace {

/// Counts are halved when there are more.
constexpr std::uint32_t kMostCounts = 1U << SymbolModel::kProbabilityBits;
constexpr std::uint32_t kMostBits = 1U << BitModel::kProbabilityBits;
constexpr std::uint32_t kMostBitCycle = 64;

/// The interval between two updates grows by a quarter each time.
std::uint32_t longer(std::uint32_t cycle, std::uint32_t most) {
  return std::min(5 * cycle / 4, most);
}

}  // namespace

void SymbolModel::reset(unsigned symbols) {
  symbols_ = symbols;
  int step_bits = 3;
  while (symbols > 1U << (step_bits + 2)) ++step_bits;
  step_shift_ = kProbabilityBits - step_bits;
  // A probability may lie above 1 by a rest of the coder's interval: that is one more step.
  values_.assign(2 * symbols + (std::size_t{1} << step_bits) + 2, 0);
  std::fill_n(values_.begin() + symbols, symbols, std::uint16_t{1});
  total_ = 0;
  cycle_ = symbols;
  update();
  cycle_ = (symbols + 6) / 2;
  until_update_ = cycle_;
}

void SymbolModel::update() {
  std::uint16_t* counts = values_.data() + symbols_;
  total_ += cycle_;
  if (total_ > kMostCounts) {
    total_ = 0;
    for (unsigned i = 0; i < symbols_; ++i) {
      counts[i] = static_cast<std::uint16_t>((counts[i] + 1) / 2);
      total_ += counts[i];
    }
  }
  const std::uint32_t scale = 0x80000000U / total_;
  std::uint16_t* steps = counts + symbols_;
  const unsigned all_steps = (1U << (kProbabilityBits - step_shift_)) + 1;
  std::uint32_t sum = 0;
  unsigned step = 0;
  for (unsigned i = 0; i < symbols_; ++i) {
    const std::uint32_t below = (scale * sum) >> (31 - kProbabilityBits);
    values_[i] = static_cast<std::uint16_t>(below);
    sum += counts[i];
    const unsigned reached = below >> step_shift_;
    while (step < reached) steps[++step] = static_cast<std::uint16_t>(i - 1);
  }
  steps[0] = 0;
  while (step < all_steps) steps[++step] = static_cast<std::uint16_t>(symbols_ - 1);
  cycle_ = longer(cycle_, 8 * (symbols_ + 6));
  until_update_ = cycle_;
}

void BitModel::update() {
  total_ += cycle_;
  if (total_ > kMostBits) {
    total_ = (total_ + 1) / 2;
    zeros_ = (zeros_ + 1) / 2;
    if (zeros_ == total_) ++total_;
  }
  zero_ = (zeros_ * (0x80000000U / total_)) >> (31 - kProbabilityBits);
  cycle_ = longer(cycle_, kMostBitCycle);
  until_update_ = cycle_;
}

}  // namespace surfel::laz
