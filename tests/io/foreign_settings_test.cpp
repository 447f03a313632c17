// Settings that libraries keep for the whole process belong to the program.

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <pcl/console/print.h>
#include <surfel/base/error.h>
#include <surfel/io/cloud_io.h>
#include <surfel/io/image_io.h>

#include "support/memory_file.h"
#include "support/run_tool.h"

namespace surfel {
namespace {

TEST(ForeignSettings, OpenImageIoKeepsItsOwn) {
  const std::pair<const char*, int> mine[] = {
      {"threads", 3}, {"exr_threads", 5}, {"limits:channels", 77}, {"limits:imagesize_MB", 99}};
  for (const auto& [name, value] : mine) OIIO::attribute(name, value);
  const test::TemporaryFolder folder;
  Image image;
  image.width = image.height = 4;
  image.channels = {"R", "G", "B", "A"};
  image.data.assign(64, 0.5F);
  for (const char* name : {"a.exr", "a.tif"}) {
    write_image(image, folder / name);
    read_image(folder / name);
    open_image(folder / name);
  }
  EXPECT_THROW(read_image(folder / "none.tif"), Error);
  for (const auto& [name, value] : mine) EXPECT_EQ(OIIO::get_int_attribute(name), value) << name;
}

TEST(ForeignSettings, PclKeepsItsVerbosity) {
  pcl::console::setVerbosityLevel(pcl::console::L_DEBUG);
  // A body that PCL is asked for and cannot decompress.
  const std::string sizes("\x04\0\0\0\x0c\0\0\0", 8);
  const test::MemoryFile damaged(
      "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\n"
      "POINTS 1\nDATA binary_compressed\n" +
      sizes + std::string("\xff\xff\xff\xff", 4));
  EXPECT_THROW(read_cloud(damaged.path()), Error);
  EXPECT_EQ(pcl::console::getVerbosityLevel(), pcl::console::L_DEBUG);
}

}  // namespace
}  // namespace surfel
