#include <algorithm>
#include <cctype>

#include <surfel/base/nearest_name.h>

namespace surfel {
namespace {

/// What is compared: lower case without leading dashes.
std::string bare(const std::string& name) {
  std::string out = name.substr(std::min(name.find_first_not_of('-'), name.size()));
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

/// Slips between two words: Damerau's distance, in which no letter is touched twice.
std::size_t slips(const std::string& a, const std::string& b) {
  std::vector<std::size_t> before_last;
  std::vector<std::size_t> last;
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before_last = std::move(last);
    last = row;
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t wrong = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, wrong});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before_last[j - 2] + 1);
    }
  }
  return row[b.size()];
}

}  // namespace

std::string nearest_name(const std::string& text, const std::vector<std::string>& names) {
  constexpr std::size_t kLongest = 64;  ///< Longer texts are no slips, and take long to compare.
  const std::string word = bare(text);
  if (word.size() > kLongest) return {};
  std::string nearest;
  std::size_t least = word.size() / 3 + 1;
  for (const std::string& name : names) {
    const std::size_t distance = slips(word, bare(name));
    if (distance >= least) continue;
    least = distance;
    nearest = name;
  }
  if (!nearest.empty() || word.size() < 3) return nearest;
  const auto begun = [&](const std::string& name) { return bare(name).starts_with(word); };
  if (std::count_if(names.begin(), names.end(), begun) != 1) return {};
  return *std::find_if(names.begin(), names.end(), begun);
}

std::string did_you_mean(const std::string& text, const std::vector<std::string>& names) {
  const std::string nearest = nearest_name(text, names);
  return nearest.empty() ? nearest : "; did you mean " + nearest + "?";
}

}  // namespace surfel
