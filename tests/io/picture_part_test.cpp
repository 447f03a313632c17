#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <surfel/io/image_io.h>
#include <surfel/io/picture_part.h>

#include "support/message_of.h"
#include "support/test_data.h"

namespace surfel::test {
namespace {

Image numbered_picture(int width, int height) {
  Image image = rgba_image(width, height);
  for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<float>(i);
  return image;
}

void write_part(const Image& picture, const PartNumber& part, const std::string& path,
                const std::string& made_by = "program 1") {
  write_image(part_of(picture, part), path,
              part_options(part, picture.height, made_by,
                           {.metadata = {{"Software", "program"}},
                            .world_to_camera = std::vector<float>(16, 0.5F)}));
}

TEST(PictureParts, MakeUpThePicture) {
  for (const int height : {1, 15, 16, 17, 100, 512, 65536}) {
    const int most = PartNumber::most_parts(height);
    for (int parts = 1; parts <= most; parts += 1 + parts / 3) {
      int next = 0;
      for (int number = 1; number <= parts; ++number) {
        const RowRange rows = PartNumber{number, parts}.rows(height);
        EXPECT_EQ(rows.begin, next);
        EXPECT_GT(rows.end, rows.begin) << number << "/" << parts << " of " << height;
        EXPECT_LE(rows.end - rows.begin, (most / parts + 1) * 16);
        next = rows.end;
      }
      EXPECT_EQ(next, height);
    }
  }
}

TEST(PictureParts, AreWrittenAsNumbersOfParts) {
  const auto part = PartNumber::parse("3/8");
  ASSERT_TRUE(part);
  EXPECT_EQ(part->number, 3);
  EXPECT_EQ(part->parts, 8);
  for (const char* text : {"", "3", "3/", "/8", "0/8", "9/8", "-1/8", "3/8 ", "3/8/1", "a/8",
                           "99999999999/99999999999"}) {
    EXPECT_FALSE(PartNumber::parse(text)) << text;
  }
}

TEST(PictureParts, AreJoinedInAnyOrder) {
  const TemporaryFolder folder;
  const Image picture = numbered_picture(13, 70);
  PictureJoin join;
  EXPECT_EQ(join.parts(), 0);
  for (const int number : {2, 3, 1}) {
    const std::string path = folder / (std::to_string(number) + ".exr");
    write_part(picture, {number, 3}, path);
    join.add(path);
    EXPECT_EQ(join.parts(), 3);
  }
  EXPECT_TRUE(join.missing().empty());
  EXPECT_EQ(join.header().made_by, "program 1");
  EXPECT_EQ(join.header().world_to_camera, std::vector<float>(16, 0.5F));
  EXPECT_EQ(join.header().metadata,
            (std::vector<std::pair<std::string, std::string>>{{"Software", "program"}}));
  const Image joined = join.take();
  EXPECT_EQ(joined.height, picture.height);
  EXPECT_EQ(joined.data, picture.data);
}

TEST(PictureParts, OfOtherPicturesAreRefused) {
  const TemporaryFolder folder;
  write_part(numbered_picture(13, 70), {1, 3}, folder / "one.exr");
  const auto message = [&](const Image& picture, const PartNumber& part, const char* made_by) {
    const std::string path = folder / "other.exr";
    write_part(picture, part, path, made_by);
    PictureJoin join;
    join.add(folder / "one.exr");
    std::string text = message_of([&] { join.add(path); });
    // What was there before stays.
    EXPECT_EQ(join.missing(), (std::vector<int>{2, 3}));
    return text;
  };
  const auto expect = [](const std::string& text, const char* part) {
    EXPECT_NE(text.find("other.exr"), std::string::npos) << text;
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  expect(message(numbered_picture(14, 70), {2, 3}, "program 1"), "is of 14x70 pixels, not 13x70");
  expect(message(numbered_picture(13, 71), {2, 3}, "program 1"), "is of 13x71 pixels");
  expect(message(numbered_picture(13, 70), {2, 4}, "program 1"), "is one of 4 parts, not of 3");
  expect(message(numbered_picture(13, 70), {2, 3}, "program 2"), "was made by \"program 2\"");
  expect(message(numbered_picture(13, 70), {1, 3}, "program 1"), "is part 1 of 3, and so is");
}

TEST(PictureParts, ThatAreNoneAreRefused) {
  const TemporaryFolder folder;
  const Image picture = numbered_picture(13, 70);
  write_image(picture, folder / "whole.exr");
  write_image(picture, folder / "whole.png");
  // Its rows are others than it says.
  ImageWriteOptions options = part_options({2, 3}, picture.height, "", {});
  options.rows_of->first_row = 0;
  write_image(part_of(picture, {2, 3}), folder / "moved.exr", options);
  write_part(picture, {2, 3}, folder / "cut.exr");
  std::filesystem::resize_file(folder / "cut.exr",
                               std::filesystem::file_size(folder / "cut.exr") / 2);
  PictureJoin join;
  for (const auto& [file, said] : {std::pair{"whole.exr", "is no part of a picture"},
                                   {"whole.png", "is no EXR file"},
                                   {"moved.exr", "make it again"},
                                   {"cut.exr", "damaged"},
                                   {"nowhere.exr", "cannot be opened"}}) {
    const std::string text = message_of([&, name = file] { join.add(folder / name); });
    EXPECT_NE(text.find(file), std::string::npos) << text;
    EXPECT_NE(text.find(said), std::string::npos) << text;
  }
  EXPECT_EQ(join.parts(), 0);
}

}  // namespace
}  // namespace surfel::test
