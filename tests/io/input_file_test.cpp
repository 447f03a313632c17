#include <clocale>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <span>
#include <string>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/camera_file.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/input_file.h>
#include <surfel/io/mesh_io.h>
#include <surfel/io/ply.h>
#include <surfel/io/scene_file.h>

#include "support/memory_file.h"
#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel {
namespace {

namespace fs = std::filesystem;
using test::MemoryFile;
using test::TemporaryFolder;

std::size_t open_descriptors() {
  const fs::directory_iterator all("/proc/self/fd");
  return static_cast<std::size_t>(std::distance(begin(all), end(all)));
}

/// A cloud of which the header is in the first bytes, and the path to it.
std::string long_file(const TemporaryFolder& folder) {
  SurfelCloud cloud;
  cloud.position.assign(100000, Vec3f(1, 2, 3));
  write_cloud(cloud, folder / "long.ply");
  return folder / "long.ply";
}

TEST(InputFile, FilesThatDoNotFitLeaveNoDescriptorOpen) {
  const MemoryFile file("");
  // More than a process can address.
  std::error_code failed;
  fs::resize_file(file.path(), std::uintmax_t{1} << 50, failed);
  ASSERT_FALSE(failed) << failed.message();
  const std::size_t before = open_descriptors();
  EXPECT_THROW(InputFile(file.path()).bytes(), Error);
  EXPECT_EQ(open_descriptors(), before);
}

TEST(InputFile, ThatBecomesShorterIsAnErrorNamingIt) {
  const TemporaryFolder folder;
  const std::string path = long_file(folder);
  const InputFile file(path);
  fs::resize_file(path, 1000);
  const std::string message = test::message_of([&] { file.bytes(); });
  EXPECT_NE(message.find(path), std::string::npos) << message;
  EXPECT_NE(message.find("shorter"), std::string::npos) << message;
}

TEST(InputFile, RecordsThatVanishAreAnErrorNamingIt) {
  const TemporaryFolder folder;
  const std::string path = long_file(folder);
  PlyFile ply{InputFile(path)};
  fs::resize_file(path, 100000);
  const std::string message = test::message_of([&] { read_cloud(ply); });
  EXPECT_NE(message.find(path), std::string::npos) << message;
}

TEST(InputFile, HeaderReachesTheLineHoweverLongItIs) {
  const std::string text = std::string(100000, 'a') + "\nend here\n" + std::string(400000, 'b');
  const MemoryFile long_header(text);
  const InputFile file(long_header.path());
  const std::string_view header = file.header("end");
  EXPECT_NE(header.find("\nend here\nb"), std::string_view::npos);
  EXPECT_LT(header.size(), text.size());
  EXPECT_EQ(file.header("none").size(), text.size());
}

template <class Read>
auto from_memory(const std::string& name, const std::string& text, const Read& read) {
  return read(InputFile(name, std::as_bytes(std::span(text))));
}

/// Nothing may look for a file of that name.
TEST(InputFile, BytesInMemoryAreReadAsTheFileWouldBe) {
  EXPECT_EQ(from_memory("a.xyz", "0 0 0\n1 2 3\n",
                        [](InputFile file) { return read_cloud(std::move(file)).position[1]; }),
            Vec3f(1, 2, 3));
  EXPECT_EQ(from_memory("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
                        [](InputFile file) { return read_mesh(std::move(file)).face.size(); }),
            1U);
  EXPECT_EQ(from_memory("a.toml", "ambient = [1, 2, 3]\n",
                        [](const InputFile& file) { return read_scene(file).ambient; }),
            Vec3f(1, 2, 3));
  EXPECT_EQ(from_memory("a.toml", "fov = 12\n",
                        [](const InputFile& file) { return read_cameras(file, {})[0].fov; }),
            12);
  const std::string message = test::message_of([] {
    from_memory("a.off", "OFF\n3 x\n", [](InputFile file) { return read_mesh(std::move(file)); });
  });
  EXPECT_EQ(message.find("a.off: line 2"), 0U) << message;
}

/// A decimal comma for the scope, from a locale that is installed or made; false if there is none.
class DecimalComma {
 public:
  DecimalComma() {
    const std::string make =
        "localedef -i de_DE -f UTF-8 " + (folder_ / "de_DE.UTF-8") + " > /dev/null 2>&1";
    if (std::setlocale(LC_NUMERIC, "de_DE.UTF-8")) {
      found_ = true;
    } else if (std::system(make.c_str()) == 0) {  // NOLINT(concurrency-mt-unsafe)
      setenv("LOCPATH", fs::path(folder_ / "").c_str(), 1);
      found_ = std::setlocale(LC_NUMERIC, "de_DE.UTF-8") != nullptr;
    }
  }
  ~DecimalComma() {
    std::setlocale(LC_NUMERIC, "C");
    unsetenv("LOCPATH");
  }
  DecimalComma(const DecimalComma&) = delete;
  DecimalComma& operator=(const DecimalComma&) = delete;
  bool found() const { return found_; }

 private:
  TemporaryFolder folder_;
  bool found_ = false;
};

TEST(Numbers, AreReadTheSameWithADecimalComma) {
  const DecimalComma comma;
  if (!comma.found()) GTEST_SKIP() << "no locale with a decimal comma can be made";
  // Numbers beyond double go another way than others.
  const MemoryFile file(
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nproperty float variance\nend_header\n1.5 -2.5e0 1.5e-400 1.5e400\n");
  const SurfelCloud cloud = read_cloud(file.path());
  EXPECT_EQ(cloud.position[0], Vec3f(1.5F, -2.5F, 0));
  EXPECT_EQ(cloud.variance[0], std::numeric_limits<float>::infinity());
}

/// Functions that read or print numbers by the program's locale.
TEST(Numbers, NoSourceReadsThemByTheLocale) {
  const std::regex by_locale(R"(\b(strto(f|d|ld)|sto(f|d|ld)|atof|v?s?n?f?printf|s?scanf)\s*\()");
  std::size_t sources = 0;
  for (const auto& entry :
       fs::recursive_directory_iterator(fs::path(SURFEL_SOURCE_DIR) / "lib" / "surfel")) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".cpp" && extension != ".h") continue;
    std::ifstream in(entry.path());
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    EXPECT_FALSE(std::regex_search(text, by_locale)) << entry.path();
    ++sources;
  }
  EXPECT_GT(sources, 100U);
}

}  // namespace
}  // namespace surfel
