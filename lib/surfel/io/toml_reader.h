#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <surfel/base/types.h>
#include <surfel/io/input_file.h>

namespace surfel {

/// One table of a TOML file. read() leaves the value alone where the key is absent, throws
/// Error(kInput) naming file, line and key where it is of another type, and remembers the key, so
/// that reject_unread() can refuse keys that nobody asked for. Internal to the io module.
class TomlTable {
 public:
  void read(const char* key, double& value) const;
  void read(const char* key, std::optional<double>& value) const;
  void read(const char* key, bool& value) const;
  void read(const char* key, std::string& value) const;
  void read(const char* key, Vec3d& value) const;
  void read(const char* key, std::optional<Vec3d>& value) const;
  void read(const char* key, Vec3f& value) const;
  /// An array of two integers, or one for both.
  void read(const char* key, int& first, int& second) const;
  /// A number in [least, most]; else Error(kInput) as well.
  void read(const char* key, float& value, double least, double most) const;
  /// Three numbers in [least, most].
  void read(const char* key, Vec3f& value, double least, double most) const;
  bool has(const char* key) const;
  /// Throws Error(kInput) naming file and the line of the key, or of the table where it has none.
  [[noreturn]] void fail(const char* key, const std::string& message) const;
  /// Throws Error(kInput) for the first key that was not read.
  void reject_unread() const;

 private:
  friend class TomlReader;
  struct Node;
  /// A table of the same file; toml++'s type stays in the source.
  TomlTable child(const void* table) const;
  std::shared_ptr<const Node> node_;
};

/// Opens a file of settings. Throws Error(kIo) for standard input ("-"): the surfels may have been
/// read from it, and what is left would be a file without settings, which is valid.
InputFile open_toml(const std::string& path);

/// A parsed TOML file.
class TomlReader {
 public:
  /// Throws Error (kIo, kInput) naming file and line.
  explicit TomlReader(const InputFile& file);
  const TomlTable& root() const { return root_; }
  /// The tables [[name]], in their order; none if there is no such array.
  std::vector<TomlTable> tables(const char* name) const;
  /// The table [name], if there is one.
  std::optional<TomlTable> table(const char* name) const;

 private:
  TomlTable root_;
};

}  // namespace surfel
