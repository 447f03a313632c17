// OpenImageIO is a second reader and writer of EXR files, to compare ours with.

#include <algorithm>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <surfel/base/error.h>
#include <surfel/base/random.h>
#include <surfel/io/image_io.h>

#include "support/message_of.h"
#include "support/run_tool.h"

namespace surfel {
namespace {

constexpr int kWidth = 70;
constexpr int kHeight = 45;

/// A file that OpenImageIO writes, and how.
struct Written {
  std::string compression;
  OIIO::TypeDesc type;
  int tile = 0;  ///< Columns and rows of a tile; 0 for rows.
  std::vector<std::string> channels = {"R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z"};
};

std::vector<float> random_values(std::size_t count) {
  std::vector<float> values(count);
  for (std::size_t i = 0; i < count; ++i) {
    values[i] = static_cast<float>(random_uniform(7, i, 0)) * (i % 9 == 0 ? 40.0F : 1.0F);
  }
  return values;
}

/// Its data window begins left of and below the first pixel of its display window.
void write_by_openimageio(const std::string& path, const Written& how) {
  const int channels = static_cast<int>(how.channels.size());
  OIIO::ImageSpec spec(kWidth, kHeight, channels, how.type);
  spec.channelnames = how.channels;
  spec.x = -4;
  spec.y = 5;
  spec.full_width = 100;
  spec.full_height = 60;
  if (how.tile > 0) spec.tile_width = spec.tile_height = how.tile;
  spec.attribute("compression", how.compression);
  const std::vector<float> values = random_values(std::size_t{kWidth} * kHeight * spec.nchannels);
  const auto output = OIIO::ImageOutput::create("exr");
  ASSERT_TRUE(output->open(path, spec)) << output->geterror();
  ASSERT_TRUE(output->write_image(OIIO::TypeFloat, values.data())) << output->geterror();
  ASSERT_TRUE(output->close());
}

/// The channels of a file as OpenImageIO reads them.
Image read_by_openimageio(const std::string& path) {
  const auto input = OIIO::ImageInput::open(path);
  const OIIO::ImageSpec& spec = input->spec();
  Image image{spec.width, spec.height, spec.channelnames, {}};
  image.data.resize(static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height) *
                    static_cast<std::size_t>(spec.nchannels));
  EXPECT_TRUE(input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeFloat, image.data.data()));
  return image;
}

TEST(Exr, IsReadAsOpenImageIoReadsIt) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.exr";
  std::vector<Written> files;
  for (const char* compression : {"none", "rle", "zips", "zip", "piz", "pxr24", "b44", "dwaa"}) {
    for (const OIIO::TypeDesc& type : {OIIO::TypeHalf, OIIO::TypeFloat}) {
      for (const int tile : {0, 16}) files.push_back({compression, type, tile});
    }
  }
  const auto named = [](std::vector<std::string> channels) {
    return Written{"zip", OIIO::TypeHalf, 0, std::move(channels)};
  };
  files.push_back(named({"Y"}));
  files.push_back(named({"Y", "A"}));
  files.push_back(named({"light.R", "light.G", "light.B", "light.A"}));
  files.push_back(named({"A"}));
  for (const Written& file : files) {
    SCOPED_TRACE(file.compression + " " + file.type.c_str() + " tile " + std::to_string(file.tile) +
                 " first " + file.channels.front());
    write_by_openimageio(path, file);
    const Image theirs = read_by_openimageio(path);
    const Image ours = read_image(path, true);
    EXPECT_EQ(ours.channels, theirs.channels);
    EXPECT_EQ(ours.data, theirs.data);
  }
}

TEST(Exr, PiecesAreCutOutOfThePicture) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.exr";
  for (const int tile : {0, 16}) {
    const std::vector<std::vector<std::string>> several = {
        {"R", "G", "B", "A", "Z"}, {"Y"}, {"Z", "N.X", "N.Y"}};
    for (const auto& channels : several) {
      SCOPED_TRACE(channels.front() + " tile " + std::to_string(tile));
      write_by_openimageio(path, {"zip", OIIO::TypeFloat, tile, channels});
      const Image whole = read_image(path);
      const auto reader = open_image(path);
      EXPECT_EQ(reader->layout().width, kWidth);
      EXPECT_EQ(reader->layout().height, kHeight);
      EXPECT_EQ(reader->layout().piece_height, std::max(1, tile));
      for (const ImageReader::Box& box :
           {ImageReader::Box{20, 41, 30, 45}, ImageReader::Box{0, kWidth, 0, kHeight},
            ImageReader::Box{69, 70, 3, 4}}) {
        std::vector<float> piece(4 * box.pixels());
        reader->read(box, piece.data());
        for (std::size_t i = 0; i < box.pixels(); ++i) {
          const int x = box.x_begin + static_cast<int>(i % box.width());
          const int y = box.y_begin + static_cast<int>(i / box.width());
          ASSERT_TRUE(std::equal(&piece[4 * i], &piece[4 * i] + 4, whole.pixel(x, y)));
        }
      }
    }
  }
}

TEST(Exr, OpenImageIoReadsWhatIsWritten) {
  const test::TemporaryFolder folder;
  Image image{kWidth, kHeight, {"R", "G", "B", "A", "Z", "weight"}, {}};
  const std::vector<float> values = random_values(std::size_t{6} * kWidth * kHeight);
  image.data.assign(values.begin(), values.end());
  ImageWriteOptions options;
  options.metadata = {{"Software", "surfel-render"}, {"Profile", "3dgs"}};
  for (int i = 0; i < 16; ++i) options.world_to_camera.push_back(static_cast<float>(i));
  options.rows_of = RowsOfPicture{30, 200};
  write_image(image, folder / "a.exr", options);
  const Image theirs = read_by_openimageio(folder / "a.exr");
  EXPECT_EQ(theirs.channels, image.channels);
  EXPECT_EQ(theirs.data, image.data);
  const auto input = OIIO::ImageInput::open(folder / "a.exr");
  const OIIO::ImageSpec& spec = input->spec();
  EXPECT_EQ(
      std::vector({spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height}),
      std::vector({0, 30, 0, 0, kWidth, 200}));
  EXPECT_EQ(spec.get_string_attribute("Profile"), "3dgs");
  EXPECT_EQ(spec.get_string_attribute("Software"), "surfel-render");
  EXPECT_EQ(spec.get_string_attribute("compression"), "zip");
  float matrix[16];
  ASSERT_TRUE(spec.getattribute("worldToCamera", OIIO::TypeMatrix, matrix));
  // Row vectors: the translation is in the last row.
  EXPECT_EQ(matrix[12], 3);
  EXPECT_EQ(matrix[1], 4);
}

TEST(Exr, ChannelsOfFewerPixelsAreRefused) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.exr";
  write_by_openimageio(path, {"none", OIIO::TypeHalf, 0, {"Y"}});
  // The list of channels: name, type, linearity, then the sampling of columns.
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), {}};
  const std::size_t name = bytes.find(std::string("\0Y\0\1", 4)) + 1;
  file.seekp(static_cast<std::streamoff>(name) + 10);
  file.put(2);
  file.close();
  EXPECT_NE(test::message_of([&] { read_image(path); }).find("fewer pixels than the picture"),
            std::string::npos);
}

}  // namespace
}  // namespace surfel
