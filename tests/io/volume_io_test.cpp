#include <bit>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/io/image_io.h>
#include <surfel/io/transfer_file.h>
#include <surfel/io/volume_io.h>

#include "io/splat_files.h"
#include "support/message_of.h"

namespace surfel::test {
namespace {

template <class T>
std::string bytes_of(const std::vector<double>& values, bool swap = false) {
  std::string out;
  for (const double value : values) {
    const T one = static_cast<T>(value);
    std::string bytes(sizeof(T), '\0');
    std::memcpy(bytes.data(), &one, sizeof(T));
    out += swap ? std::string(bytes.rbegin(), bytes.rend()) : bytes;
  }
  return out;
}

class VolumeIo : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::path(testing::TempDir()) /
        ("volume_io_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string put(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return (folder_ / name).string();
  }
  /// The message about a file of these bytes.
  std::string refused(const std::string& name, const std::string& bytes) const {
    const std::string path = put(name, bytes);
    const std::string message = message_of([&] { read_volume(path); });
    EXPECT_TRUE(message.starts_with(path)) << message;
    return message;
  }

  std::filesystem::path folder_;
  const std::vector<double> values_{-3, 0, 7, 100, 5, -90, 12, 1, 2, 3, 4, 99};
};

std::string nrrd(const std::string& type, const std::string& more,
                 const std::string& encoding = "raw") {
  return "NRRD0004\n# a comment\ntype: " + type +
         "\ndimension: 3\nsizes: 2 3 2\nkey:=value\nencoding: " + encoding + "\n" + more + "\n";
}

void expect_values(const Volume& volume, const std::vector<double>& values) {
  EXPECT_EQ(volume.size, (std::array<std::size_t, 3>{2, 3, 2}));
  ASSERT_EQ(volume.value.size(), values.size());
  for (std::size_t i = 0; i < values.size(); ++i) EXPECT_EQ(volume.value[i], values[i]) << i;
}

TEST_F(VolumeIo, NrrdOfAllTypes) {
  expect_values(read_volume(put("a.nrrd", nrrd("int8", "") + bytes_of<std::int8_t>(values_))),
                values_);
  expect_values(read_volume(put("b.nrrd", nrrd("short", "endian: big\n") +
                                              bytes_of<std::int16_t>(values_, true))),
                values_);
  expect_values(
      read_volume(put("c.nrrd", nrrd("float", "endian: little\n") + bytes_of<float>(values_))),
      values_);
  expect_values(
      read_volume(put("d.nrrd", nrrd("double", "endian: big\n") + bytes_of<double>(values_, true))),
      values_);
  expect_values(read_volume(put("e.nrrd", nrrd("int", "endian: little\n", "gzip") +
                                              gzipped(bytes_of<std::int32_t>(values_)))),
                values_);
}

TEST_F(VolumeIo, NrrdGridsLieInSpace) {
  const Volume volume =
      read_volume(put("a.nrrd", nrrd("uchar",
                                     "space: left-posterior-superior\nspace directions: (0,2,0) "
                                     "(-1,0,0) (0,0,0.5)\nspace origin: (10, 20, 30)\n") +
                                    std::string(12, 'a')));
  EXPECT_EQ(volume.world({1, 2, 2}), Vec3d(8, 22, 31));
  EXPECT_EQ(volume.up, Vec3d(0, 0, 1));
  const Volume spaced =
      read_volume(put("b.nrrd", nrrd("uchar", "spacings: 2 3 nan\n") + std::string(12, 'a')));
  EXPECT_EQ(spaced.world({1, 1, 1}), Vec3d(2, 3, 1));
}

TEST_F(VolumeIo, ValuesMayLieBesideTheHeader) {
  put("values.raw", bytes_of<std::int8_t>(values_));
  expect_values(read_volume(put("a.nhdr", nrrd("int8", "data file: values.raw\n"))), values_);
  put("more.raw", "skip" + bytes_of<std::int8_t>(values_));
  const std::string mhd = "NDims = 3\nDimSize = 2 3 2\nElementType = MET_CHAR\n";
  expect_values(read_volume(put("b.mhd", mhd + "HeaderSize = 4\nElementDataFile = more.raw\n")),
                values_);
  expect_values(read_volume(put("c.mhd", mhd + "HeaderSize = -1\nElementDataFile = more.raw\n")),
                values_);
}

TEST_F(VolumeIo, MetaImagePlainAndCompressed) {
  const std::string header =
      "ObjectType = Image\nNDims = 3\nDimSize = 2 3 2\nElementSpacing = 1 2 4\nOffset = 5 6 7\n"
      "TransformMatrix = 0 1 0 -1 0 0 0 0 1\n";
  const Volume plain =
      read_volume(put("a.mha", header +
                                   "ElementByteOrderMSB = True\nElementType = MET_SHORT\n"
                                   "ElementDataFile = LOCAL\n" +
                                   bytes_of<std::int16_t>(values_, true)));
  expect_values(plain, values_);
  EXPECT_EQ(plain.world({1, 1, 1}), Vec3d(3, 7, 11));
  expect_values(read_volume(put("b.mha", header +
                                             "CompressedData = True\nElementType = MET_FLOAT\n"
                                             "ElementDataFile = LOCAL\n" +
                                             zlib_packed(bytes_of<float>(values_)))),
                values_);
}

TEST_F(VolumeIo, ValuesThatAreNotFiniteCountAsTheLeast) {
  std::vector<double> values = values_;
  values[3] = std::numeric_limits<double>::quiet_NaN();
  values[4] = std::numeric_limits<double>::infinity();
  const Volume volume =
      read_volume(put("a.nrrd", nrrd("float", "endian: little\n") + bytes_of<float>(values)));
  EXPECT_EQ(volume.not_finite, 2U);
  EXPECT_EQ(volume.value[3], -90);
  EXPECT_EQ(volume.value[4], -90);
  const std::vector<double> none(12, std::numeric_limits<double>::quiet_NaN());
  EXPECT_NE(refused("b.nrrd", nrrd("float", "") + bytes_of<float>(none)).find("finite"),
            std::string::npos);
}

TEST_F(VolumeIo, RefusesBrokenNrrd) {
  const std::string body(12, 'a');
  EXPECT_NE(refused("a.nrrd", nrrd("uchar", "") + body.substr(1)).find("room for 11"),
            std::string::npos);
  EXPECT_NE(
      refused("b.nrrd", nrrd("uchar", "", "gzip") + gzipped(body).substr(0, 11)).find("truncated"),
      std::string::npos);
  const std::string head = nrrd("uchar", "", "gzip");
  expect_values(read_volume(put("b2.nrrd", head + gzipped(body.substr(4)) + gzipped("aaaa"))),
                std::vector<double>(12, 'a'));
  EXPECT_NE(refused("b3.nrrd", head + gzipped(body + "a")).find("more than the 12 bytes"),
            std::string::npos);
  EXPECT_NE(refused("b4.nrrd", head + gzipped(body) + "a").find("followed by bytes"),
            std::string::npos);
  EXPECT_NE(refused("c.nrrd", nrrd("uchar", "", "gzip") + body).find("compressed"),
            std::string::npos);
  EXPECT_NE(refused("d.nrrd", nrrd("block", "") + body).find("block"), std::string::npos);
  EXPECT_NE(refused("e.nrrd", nrrd("uchar", "", "bzip2") + body).find("raw and gzip"),
            std::string::npos);
  EXPECT_NE(refused("f.nrrd", "NRRD0004\ntype: uchar\n").find("no end"), std::string::npos);
  EXPECT_NE(refused("g.nrrd", "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 3 2 1\n\n" + body)
                .find("dimension"),
            std::string::npos);
  EXPECT_NE(refused("h.nrrd",
                    "NRRD0004\ntype: uchar\ndimension: 3\nencoding: raw\nsizes: "
                    "900000000 900000000 900000000\n\n" +
                        body)
                .find("not supported"),
            std::string::npos);
  EXPECT_NE(refused("i.nrrd",
                    "NRRD0004\ntype: uchar\ndimension: 3\nencoding: raw\nsizes: 2 -3 "
                    "2\n\n" +
                        body)
                .find("-3"),
            std::string::npos);
  EXPECT_NE(refused("j.nrrd", nrrd("uchar", "space directions: (1,0,0) (1,1,0) (0,0,1)\n") + body)
                .find("right angles"),
            std::string::npos);
  EXPECT_NE(refused("k.nrrd", nrrd("uchar", "spacings: 0 1 1\n") + body).find("zero"),
            std::string::npos);
  EXPECT_NE(refused("n.nrrd", nrrd("uchar", "spacings: 1e300 1 1\n") + body).find("1e15"),
            std::string::npos);
  EXPECT_NE(refused("l.nrrd", "no volume at all").find("neither"), std::string::npos);
  EXPECT_NE(refused("m.nrrd", "").find("empty"), std::string::npos);
}

TEST_F(VolumeIo, RefusesBrokenMetaImage) {
  const std::string body(12, 'a');
  const std::string start = "NDims = 3\nElementType = MET_UCHAR\n";
  const std::string local = "ElementDataFile = LOCAL\n";
  EXPECT_NE(refused("a.mha", start + "DimSize = 2 3 2\n" + local + body.substr(1)).find("room for"),
            std::string::npos);
  EXPECT_NE(refused("b.mha", start + "DimSize = 2 3\n" + local + body).find("DimSize"),
            std::string::npos);
  EXPECT_NE(refused("c.mha", start + "DimSize = 2 3 2\n").find("ElementDataFile"),
            std::string::npos);
  EXPECT_NE(
      refused("d.mha", start + "DimSize = 2 3 2\nElementNumberOfChannels = 3\n" + local + body)
          .find("one scalar"),
      std::string::npos);
  const std::string missing = put("e.mhd", start + "DimSize = 2 3 2\nElementDataFile = none.raw\n");
  EXPECT_NE(message_of([&] { read_volume(missing); }).find("none.raw"), std::string::npos);
}

TEST_F(VolumeIo, ImagesAreAStackInTheOrderOfTheirNumbers) {
  std::vector<std::string> names;
  for (const int z : {10, 9, 2}) {
    Image image = rgba_image(3, 2);
    for (std::size_t i = 0; i < image.data.size(); ++i) {
      image.data[i] = i % 4 == 3 ? 1.0F : static_cast<float>(z) / 16;
    }
    names.push_back((folder_ / ("slice" + std::to_string(z) + ".exr")).string());
    write_image(image, names.back());
  }
  const Volume volume = read_image_stack(names, {1, 2, 3});
  EXPECT_EQ(volume.size, (std::array<std::size_t, 3>{3, 2, 3}));
  EXPECT_EQ(volume.world({1, 1, 1}), Vec3d(1, 2, 3));
  for (std::size_t z = 0; z < 3; ++z) {
    EXPECT_EQ(volume.value[volume.index(1, 1, z)], (z == 0 ? 2 : z == 1 ? 9 : 10) / 16.0F);
  }
  write_image(rgba_image(4, 2), names[0]);
  EXPECT_NE(message_of([&] {
              read_image_stack(names, {1, 1, 1});
            }).find("4 x 2"),
            std::string::npos);
}

TEST_F(VolumeIo, TransferFunctionsComeFromToml) {
  const TransferFunction function =
      read_transfer_function(put("a.toml",
                                 "relative = true\n[[point]]\nvalue = 0.1\n[[point]]\nvalue = 0.5\n"
                                 "color = [1, 0.5, 0]\ndensity = 2\n"));
  EXPECT_TRUE(function.relative);
  ASSERT_EQ(function.point.size(), 2U);
  EXPECT_EQ(function.point[0].density, 0);
  EXPECT_EQ(function.point[1].color, Vec3f(1, 0.5F, 0));
  for (const char* text :
       {"", "[[point]]\ncolor = [1, 1, 1]\n", "[[point]]\nvalue = 1\nhue = 2\n",
        "[[point]]\nvalue = 1\ndensity = -1\n", "[[point]]\nvalue = 1\n[[point]]\nvalue = 0\n"}) {
    const std::string path = put("b.toml", text);
    EXPECT_TRUE(message_of([&] { read_transfer_function(path); }).starts_with(path)) << text;
  }
}

}  // namespace
}  // namespace surfel::test
