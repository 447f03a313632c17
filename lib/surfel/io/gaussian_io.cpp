#include <filesystem>
#include <optional>
#include <utility>

#include <surfel/base/error.h>
#include <surfel/base/output_file.h>
#include <surfel/io/compressed_ply.h>
#include <surfel/io/file_kind.h>
#include <surfel/io/gaussian_io.h>
#include <surfel/io/gaussian_levels.h>
#include <surfel/io/gaussian_ply.h>
#include <surfel/io/gaussian_usda.h>
#include <surfel/io/ksplat.h>
#include <surfel/io/splat.h>
#include <surfel/io/spz.h>
#include <surfel/io/text_scanner.h>

namespace surfel {
namespace {

enum class SplatFormat { kTrainedPly, kCompressedPly, kSplat, kSpz, kKsplat };

/// The header of a PLY file alone; the records stay where they are.
PlyFile header_of(const InputFile& input) {
  const std::string_view text = input.header("end_header");
  return PlyFile(InputFile(input.name(), std::as_bytes(std::span(text.data(), text.size()))));
}

/// The format of a file of Gaussians, or nothing where it holds none.
std::optional<SplatFormat> splat_format(const InputFile& input) {
  if (PlyFile::matches(input.head(4))) {
    const PlyFile ply = header_of(input);
    if (has_trained_gaussians(ply.header())) return SplatFormat::kTrainedPly;
    if (has_packed_gaussians(ply.header())) return SplatFormat::kCompressedPly;
    return std::nullopt;
  }
  const std::string extension = lower_extension(input.name());
  if (is_spz(input) || extension == ".spz") return SplatFormat::kSpz;
  if (extension == ".splat") return SplatFormat::kSplat;
  if (extension == ".ksplat") return SplatFormat::kKsplat;
  return std::nullopt;
}

/// May a file be opened before it is read? What was read of a pipe would be lost.
bool may_look(const std::string& path) {
  std::error_code none;
  const std::filesystem::file_status status = std::filesystem::status(path, none);
  const bool pipe = std::filesystem::exists(status) && std::filesystem::is_other(status);
  return path != "-" && !pipe;
}

}  // namespace

bool is_splat_name(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".splat" || extension == ".spz" || extension == ".ksplat";
}

bool holds_gaussians(const InputFile& input) { return splat_format(input).has_value(); }

bool holds_gaussians(const std::string& path) {
  return may_look(path) && holds_gaussians(InputFile(path));
}

bool has_gaussian_levels(const std::string& path) {
  if (!may_look(path)) return false;
  const InputFile input(path);
  return PlyFile::matches(input.head(4)) && has_gaussian_levels(header_of(input).header());
}

GaussianCloud read_gaussians(InputFile input, const GaussianReadOptions& options) {
  const std::string name = input.name();
  if (input.size() == 0) throw_input(name, "is empty; make it anew");
  const std::optional<SplatFormat> format = splat_format(input);
  if (!format) {
    throw_input(name,
                "holds no trained Gaussians; they are read from PLY, .splat, .spz and "
                ".ksplat" +
                    converter_advice(name));
  }
  switch (*format) {
    case SplatFormat::kTrainedPly: {
      PlyFile ply(std::move(input));
      return read_gaussian_ply(ply, options);
    }
    case SplatFormat::kCompressedPly: {
      PlyFile ply(std::move(input));
      return read_compressed_ply(ply, options);
    }
    case SplatFormat::kSpz:
      return read_spz(input, options);
    case SplatFormat::kKsplat:
      return read_ksplat(input, options);
    case SplatFormat::kSplat:
      break;
  }
  return read_splat(input, options);
}

GaussianCloud read_gaussians(const std::string& path, const GaussianReadOptions& options) {
  return read_gaussians(InputFile(path), options);
}

void write_gaussians(const GaussianCloud& cloud, const std::string& path,
                     const GaussianWriteOptions& options) {
  const std::string extension = lower_extension(path);
  const bool splat = extension == ".splat";
  const bool usda = extension == ".usda";
  if (!splat && !usda && !extension.empty() && extension != ".ply") {
    throw_usage(path + ": Gaussians are written as PLY, .splat or .usda; give such an extension");
  }
  if ((splat || usda) && cloud.rule == AmplitudeRule::kDensity) {
    throw_usage(path + ": " + extension + " has no place for densities; write PLY");
  }
  if ((splat || usda) && !cloud.tree.empty()) {
    throw_usage(path + ": " + extension + " has no place for levels of detail; write PLY");
  }
  OutputFile file(path, options.no_clobber);
  if (splat) {
    write_splat(cloud, file);
  } else if (usda) {
    write_gaussian_usda(cloud, file, options);
  } else {
    write_gaussian_ply(cloud, file, options);
  }
  file.commit();
}

}  // namespace surfel
