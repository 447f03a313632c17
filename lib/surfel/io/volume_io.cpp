#include <algorithm>
#include <string_view>

#include <fmt/format.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/io/meta_image.h>
#include <surfel/io/nrrd.h>
#include <surfel/io/text_scanner.h>
#include <surfel/io/volume_io.h>
#include <surfel/io/voxel_values.h>

namespace surfel {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Whether a name comes before another one, where runs of digits are numbers.
bool before(std::string_view a, std::string_view b) {
  std::size_t i = 0;
  std::size_t j = 0;
  const auto number = [](std::string_view text, std::size_t& at) {
    const std::size_t start = std::min(text.find_first_not_of('0', at), text.size());
    at = start;
    while (at < text.size() && is_digit(text[at])) ++at;
    return text.substr(start, at - start);
  };
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string_view p = number(a, i);
      const std::string_view q = number(b, j);
      if (p.size() != q.size()) return p.size() < q.size();
      if (p != q) return p < q;
      continue;
    }
    if (a[i] != b[j]) return a[i] < b[j];
    ++i;
    ++j;
  }
  return a.size() - i < b.size() - j;
}

}  // namespace

Volume read_volume(const std::string& path) { return read_volume(InputFile(path)); }

Volume read_volume(const InputFile& input) {
  if (input.size() == 0) throw_input(input.name(), "is empty; make it anew");
  constexpr std::size_t kStart = 512;
  const std::string_view start = as_text(input.head(std::min(kStart, input.size())));
  Volume volume;
  if (start.starts_with("NRRD")) {
    volume = read_nrrd(input);
  } else if (start.find("NDims") != std::string_view::npos) {
    volume = read_meta_image(input);
  } else {
    throw_input(input.name(), "is neither NRRD nor MetaImage");
  }
  finish_volume(volume, input.name());
  return volume;
}

Volume read_image_stack(std::vector<std::string> images, const Vec3d& spacing) {
  if (images.empty()) throw_usage("a stack of images needs one image at least");
  std::sort(images.begin(), images.end(),
            [](const std::string& a, const std::string& b) { return before(a, b); });
  Volume volume;
  for (int k = 0; k < 3; ++k) volume.step[static_cast<std::size_t>(k)] *= spacing[k];
  for (std::size_t z = 0; z < images.size(); ++z) {
    const Image image = read_data_image(images[z]);
    const auto width = static_cast<std::size_t>(image.width);
    const auto height = static_cast<std::size_t>(image.height);
    if (z == 0) {
      volume.size = {width, height, images.size()};
      require_volume(volume, images[z]);
      volume.value.resize(volume.voxels());
    }
    if (width != volume.size[0] || height != volume.size[1]) {
      throw_input(images[z], fmt::format("has {} x {} pixels, the first image of the stack has {} "
                                         "x {}",
                                         width, height, volume.size[0], volume.size[1]));
    }
    const std::size_t channels = image.channels.size();
    float* to = volume.value.data() + volume.index(0, 0, z);
    for (std::size_t i = 0; i < width * height; ++i) to[i] = image.data[i * channels];
  }
  finish_volume(volume, images.front());
  return volume;
}

bool is_volume_name(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".nrrd" || extension == ".nhdr" || extension == ".mha" || extension == ".mhd";
}

}  // namespace surfel
