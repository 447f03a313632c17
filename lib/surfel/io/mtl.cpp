#include <algorithm>
#include <array>
#include <cmath>

#include <surfel/io/line_scanner.h>
#include <surfel/io/mtl.h>
#include <surfel/io/text_numbers.h>

namespace surfel {
namespace {

constexpr std::string_view kBlanks = " \t";

std::string_view first_word(std::string_view text) {
  return text.substr(0, std::min(text.find_first_of(kBlanks), text.size()));
}

std::string_view after_word(std::string_view text) {
  const std::size_t stop = text.find_first_of(kBlanks);
  if (stop == std::string_view::npos) return {};
  return text.substr(std::min(text.find_first_not_of(kBlanks, stop), text.size()));
}

/// The file's name without the options in front of it ("-s 1 1 1 -clamp on wood 1.png"). -o, -s and
/// -t take up to three numbers, -mm two values, the others one.
std::string_view without_options(std::string_view text) {
  while (text.starts_with('-')) {
    const std::string_view option = first_word(text);
    std::string_view rest = after_word(text);
    if (option == "-o" || option == "-s" || option == "-t") {
      for (int i = 0; i < 3 && parse_number(first_word(rest)); ++i) rest = after_word(rest);
    } else {
      rest = after_word(option == "-mm" ? after_word(rest) : rest);
    }
    if (rest.empty()) break;  // A name that starts with a dash.
    text = rest;
  }
  if (text.size() > 1 && text.front() == '"' && text.back() == '"') {
    text = text.substr(1, text.size() - 2);
  }
  return text;
}

/// Three numbers, or one for all; colours given as spectra or CIE XYZ are left out.
void read_diffuse(LineScanner& in, Vec3f& diffuse) {
  std::array<double, 3> value{};
  std::size_t count = 0;
  for (; count < 3 && !in.at_line_end(); ++count) {
    value[count] = parse_number(in.word()).value_or(std::nan(""));
    if (!std::isfinite(value[count])) return;
  }
  if (count == 1) value[1] = value[2] = value[0];
  if (count == 1 || count == 3) diffuse = Vec3d(value[0], value[1], value[2]).cast<float>();
}

}  // namespace

std::optional<std::string> find_beside(const std::filesystem::path& folder, std::string_view name) {
  const auto regular = [&](const std::string& candidate) -> std::optional<std::string> {
    std::error_code ignored;
    const std::filesystem::path path = folder / candidate;
    if (candidate.empty() || !std::filesystem::is_regular_file(path, ignored)) return std::nullopt;
    return path.lexically_normal().string();
  };
  std::string turned(name);
  if (auto found = regular(turned)) return found;
  std::replace(turned.begin(), turned.end(), '\\', '/');
  if (auto found = regular(turned)) return found;
  return regular(std::filesystem::path(turned).filename().string());
}

std::string resolve_texture(const std::filesystem::path& folder, std::string_view name) {
  if (auto found = find_beside(folder, name)) return *found;
  return (folder / name).lexically_normal().string();
}

std::string texture_name_from(const std::filesystem::path& folder, const std::string& texture) {
  namespace fs = std::filesystem;
  const fs::path file = fs::weakly_canonical(fs::absolute(texture));
  const fs::path relative = file.lexically_relative(fs::weakly_canonical(fs::absolute(folder)));
  return relative.empty() || *relative.begin() == ".." ? file.string() : relative.string();
}

std::vector<MeshMaterial> read_mtl(const InputFile& file) {
  const std::filesystem::path folder = std::filesystem::path(file.name()).parent_path();
  std::vector<MeshMaterial> materials;
  LineScanner in(file);
  for (; in.skip_to_content(); in.next_line()) {
    const std::string_view keyword = in.word();
    if (keyword == "newmtl") {
      materials.push_back({.name = std::string(in.rest_of_line()), .texture = {}});
    } else if (materials.empty()) {
      continue;
    } else if (keyword == "Kd") {
      read_diffuse(in, materials.back().diffuse);
    } else if (keyword == "map_Kd") {
      const std::string_view name = without_options(in.rest_of_line());
      if (!name.empty()) materials.back().texture = resolve_texture(folder, name);
    }
  }
  return materials;
}

}  // namespace surfel
