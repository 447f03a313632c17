#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include <surfel/base/error.h>
#include <surfel/io/ply.h>

#include "support/memory_file.h"
#include "support/test_data.h"

namespace surfel {
namespace {

using test::MemoryFile;
using test::TemporaryFolder;

PlyFile open(const std::string& bytes) { return PlyFile(InputFile(MemoryFile(bytes).path())); }

/// The message of the error that opening the bytes and reading column x of `vertex` gives, without
/// the file's name in front.
std::string error(const std::string& bytes) {
  const MemoryFile file(bytes);
  try {
    PlyFile(InputFile(file.path())).column<float>("vertex", "x");
  } catch (const Error& e) {
    const std::string message = e.what();
    EXPECT_TRUE(message.starts_with(file.path() + ": ")) << message;
    return message.substr(file.path().size() + 2);
  }
  return "no error";
}

/// Bytes of a value in the byte order asked for.
template <class T>
std::string bytes_of(T value, bool big_endian) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  if (big_endian != (std::endian::native == std::endian::big)) {
    std::reverse(bytes.begin(), bytes.end());
  }
  return bytes;
}

TEST(Ply, EveryTypeReadsTheSameFromEveryFormat) {
  const std::string elements =
      "element face 2\nproperty list uchar int corners\nproperty float weight\n"
      "element vertex 2\nproperty char a\nproperty uint8 b\nproperty short c\nproperty uint16 d\n"
      "property int32 e\nproperty uint f\nproperty float32 x\nproperty double y\n"
      "property list ushort double empty\nend_header\n";
  std::string binary[2];
  for (const bool big : {false, true}) {
    const auto put = [&](auto... values) { binary[big] = (bytes_of(values, big) + ...); };
    using u8 = std::uint8_t;
    put(u8{3}, 0, 1, -70000, 0.5f, u8{0}, -1.5f,                                 //
        std::int8_t{-128}, u8{255}, std::int16_t{-32768}, std::uint16_t{65535},  //
        std::int32_t{-2147483647}, std::uint32_t{4294967295}, 0.1f, 0.1,         //
        std::uint16_t{0},                                                        //
        std::int8_t{127}, u8{0}, std::int16_t{32767}, std::uint16_t{0},          //
        std::int32_t{2147483647}, std::uint32_t{0}, -1e-30f, -1e300, std::uint16_t{1}, 2.5);
  }
  const std::string text =
      "3 0 1 -70000 0.5\n0 -1.5\n"
      "-128 255 -32768 65535 -2147483647 4294967295 0.1 0.1 0\n"
      "127 0 32767 0 2147483647 0 -1e-30 -1e300 1 2.5";
  const std::string files[] = {"ply\nformat ascii 1.0\n" + elements + text,
                               "ply\nformat binary_little_endian 1.0\n" + elements + binary[0],
                               "ply\nformat binary_big_endian 1.0\n" + elements + binary[1]};
  for (const std::string& bytes : files) {
    PlyFile file = open(bytes);
    const auto column = [&](const char* name) { return file.column<double>("vertex", name); };
    EXPECT_EQ(column("a"), (Array<double>{-128, 127}));
    EXPECT_EQ(column("b"), (Array<double>{255, 0}));
    EXPECT_EQ(column("c"), (Array<double>{-32768, 32767}));
    EXPECT_EQ(column("d"), (Array<double>{65535, 0}));
    EXPECT_EQ(column("e"), (Array<double>{-2147483647, 2147483647}));
    EXPECT_EQ(column("f"), (Array<double>{4294967295, 0}));
    EXPECT_EQ(column("x"), (Array<double>{0.1f, -1e-30f}));
    EXPECT_EQ(column("y"), (Array<double>{0.1, -1e300}));
    EXPECT_EQ(file.lists<double>("vertex", "empty").offset, (Array<std::size_t>{0, 0, 1}));
    EXPECT_EQ(file.lists<double>("vertex", "empty").value, (Array<double>{2.5}));
    const auto corners = file.lists<std::int32_t>("face", "corners");
    EXPECT_EQ(corners.offset, (Array<std::size_t>{0, 3, 3}));
    EXPECT_EQ(corners.value, (Array<std::int32_t>{0, 1, -70000}));
    EXPECT_EQ(file.column<float>("face", "weight"), (Array<float>{0.5f, -1.5f}));
  }
}

TEST(Ply, HeaderMayBeUntidy) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    const std::string header =
        "ply  " + end + "format\tascii   1.0\t" + end + "comment  two  words " + end +
        "obj_info num_cols 512" + end + end + "  element vertex\t2 " + end + "property  float x" +
        end + "comment" + end + "\tproperty list uchar int l" + end + " end_header " + end;
    PlyFile file = open(header + "+1 0" + end + end + " nan\t2 " + end + "7 8 " + end);
    EXPECT_EQ(file.header().comments, (std::vector<std::string>{"two  words", ""}));
    EXPECT_EQ(file.header().obj_info, (std::vector<std::string>{"num_cols 512"}));
    const Array<float> x = file.column<float>("vertex", "x");
    EXPECT_EQ(x[0], 1);
    EXPECT_TRUE(std::isnan(x[1]));
    EXPECT_EQ(file.lists<float>("vertex", "l").value, (Array<float>{7, 8}));
  }
}

TEST(Ply, BinaryDataMayStartWithAnyByte) {
  for (const std::string end : {"\n", "\r\n"}) {
    for (const std::uint8_t first : std::initializer_list<std::uint8_t>{0, 10, 13, 32}) {
      PlyFile file = open(
          "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
          "property uchar x\nend_header" +
          end + bytes_of(first, false) + "\n");
      EXPECT_EQ(file.column<std::uint8_t>("vertex", "x"), (Array<std::uint8_t>{first, 10}));
    }
  }
}

TEST(Ply, NumbersInText) {
  const std::string header =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
      "property int i\nend_header\n";
  const auto x = [&](const std::string& text) {
    return open(header + text + " 255.0\n").column<float>("vertex", "x")[0];
  };
  EXPECT_EQ(x(".5"), 0.5f);
  EXPECT_EQ(x("-5."), -5.0f);
  EXPECT_EQ(x("+1E+2"), 100.0f);
  EXPECT_EQ(x("1e-60"), 0.0f);
  EXPECT_EQ(x("-1e60"), -INFINITY);
  EXPECT_EQ(x("Infinity"), INFINITY);
  EXPECT_EQ(x("-1.#INF"), -INFINITY);
  EXPECT_TRUE(std::isnan(x("-nan")));
  EXPECT_TRUE(std::isnan(x("1.#IND")));
  EXPECT_EQ(open(header + "1 255.0").column<std::uint8_t>("vertex", "i")[0], 255);
}

TEST(Ply, BrokenHeadersAreRefusedWithTheirLine) {
  EXPECT_EQ(error(""), "is empty; make it anew");
  EXPECT_EQ(error("plywood\n"), "is not a PLY file: it does not start with 'ply'");
  EXPECT_EQ(error("ply\nformat ascii 1.0\nelement vertex 1\n"),
            "line 3: the header ends without 'end_header'; the file is truncated");
  EXPECT_EQ(error("ply\nelement vertex 1\nproperty float x\nend_header\n1\n"),
            "line 4: the header has no 'format' line");
  const std::string start = "ply\nformat ascii 1.0\n";
  EXPECT_EQ(error("ply\nformat utf8 1.0\nend_header\n"),
            "line 2: format 'utf8' is none of ascii, binary_little_endian, binary_big_endian");
  EXPECT_EQ(error(start + "vertices 3\nend_header\n"),
            "line 3: 'vertices' is not a word of PLY headers");
  EXPECT_EQ(error(start + "element vertex -1\nend_header\n"),
            "line 3: '-1' is not a count of elements");
  EXPECT_EQ(error(start + "element vertex 99999999999999999999\nend_header\n"),
            "line 3: '99999999999999999999' is not a count of elements");
  EXPECT_EQ(error(start + "property float x\nend_header\n"),
            "line 3: a property stands before the first element");
  EXPECT_EQ(error(start + "element vertex 1\nproperty list float int x\nend_header\n"),
            "line 4: a list is counted by an integer type");
  EXPECT_EQ(error(start + "element vertex 1\nproperty float\nend_header\n"),
            "line 4: the property has no name");
  EXPECT_EQ(error(start + "element vertex 1\nproperty float x\nproperty int x\nend_header\n1 1\n"),
            "line 5: property x of element vertex stands there twice");
  EXPECT_EQ(error(start + "element vertex 1\nelement vertex 1\nend_header\n"),
            "line 4: element vertex stands there twice");
  EXPECT_TRUE(error(start + "element vertex 1\nproperty float128 x\nend_header\n1\n")
                  .starts_with("line 4: type 'float128' is unknown; known are char"));
  EXPECT_EQ(error(start + "end_header\n"), "has no element 'vertex'");
  EXPECT_EQ(error(start + "element vertex 0\nproperty float y\nend_header\n"),
            "element vertex has no scalar property 'x'");
}

TEST(Ply, LyingCountsAreRefusedBeforeAnyAllocation) {
  for (const std::string format : {"ascii", "binary_little_endian"}) {
    const std::string start = "ply\nformat " + format + " 1.0\n";
    const std::string vertex = "element vertex 1000000000000\nproperty float x\n";
    const std::string face = "element face 1000000000000\nproperty list uchar int c\n";
    const std::string room = format == "ascii" ? "4" : "2";
    EXPECT_EQ(error(start + vertex + "end_header\n1 2 3 4 "),
              "the header promises 1000000000000 of element vertex, the file has room for " + room +
                  " at most; it is truncated or its header is wrong");
    EXPECT_TRUE(error(start + face + vertex + "end_header\n1 2 3 4 ")
                    .starts_with("the header promises 1000000000000 of element face"));
    EXPECT_TRUE(
        error(start + "element vertex 18446744073709551615\nproperty double x\nend_header\n")
            .starts_with("the header promises 18446744073709551615 of element vertex"));
  }
}

TEST(Ply, MoreColumnsThanAProgramWritesAreRefused) {
  // Each is looked for among those before it: a header of a megabyte would take minutes.
  std::string properties;
  std::string elements;
  for (int i = 0; i <= 8192; ++i) {
    properties += "property float p" + std::to_string(i) + "\n";
    elements += "element e" + std::to_string(i) + " 0\n";
  }
  const std::string start = "ply\nformat ascii 1.0\n";
  EXPECT_EQ(error(start + "element vertex 1\n" + properties + "end_header\n"),
            "line 8196: more than 8192 properties of an element are not supported; leave some out");
  EXPECT_EQ(error(start + elements + "end_header\n"),
            "line 8195: more than 8192 elements are not supported; leave some out");
}

TEST(Ply, BrokenRecordsAreRefusedWithTheirPlace) {
  const std::string start =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
      "property uchar red\nend_header\n";
  EXPECT_EQ(error(start + "1 1\nbad 2\n"),
            "line 8: 'bad' in vertex 1 (x) is not a number of type float");
  EXPECT_EQ(error(start + "1 1\n2 256\n"),
            "line 8: '256' in vertex 1 (red) is not a number of type uchar");
  EXPECT_EQ(error(start + "1 0.5\n2 255\n"),
            "line 7: '0.5' in vertex 0 (red) is not a number of type uchar");
  EXPECT_EQ(error(start + "1 1\n\n222222\n"),
            "line 10: the file ends within vertex 1 (red); it is truncated");
  EXPECT_EQ(error(start + "1 1 1\n2 2\n"),
            "line 7: more values than vertex 0 has according to the header");
  const std::string list =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
      "property list int uchar l\nend_header\n";
  EXPECT_EQ(error(list + "1 -1\n"), "line 7: -1 items in vertex 0 (l)");
  EXPECT_EQ(
      error(list + "1 2000000000\n"),
      "line 7: vertex 0 (l) promises 2000000000 items, the file has room for 1 at most; it is "
      "truncated or its header is wrong");
}

TEST(Ply, EveryTruncationOfABinaryFileWithListsIsAnError) {
  std::string bytes =
      "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty double x\n"
      "property list short float l\nend_header\n";
  for (std::int16_t n = 0; n < 3; ++n) {
    bytes += bytes_of(0.5 * n, true) + bytes_of(n, true);
    for (int i = 0; i < n; ++i) bytes += bytes_of(1.0f, true);
  }
  EXPECT_EQ(error(bytes), "no error");
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_NE(error(bytes.substr(0, size)), "no error") << size;
  }
}

TEST(Ply, ValuesThatDoNotFitAreRefused) {
  const std::string start =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\n"
      "property list uchar uint l\nend_header\n";
  PlyFile file = open(start + "1 0\n0.5 2 1 4294967295\n");
  EXPECT_EQ(file.column<float>("vertex", "x"), (Array<float>{1, 0.5f}));
  EXPECT_THROW(file.column<std::uint8_t>("vertex", "x"), Error);
  EXPECT_EQ(file.lists<std::uint32_t>("vertex", "l").value.back(), 4294967295);
  EXPECT_THROW(file.lists<std::int32_t>("vertex", "l"), Error);
}

TEST(Ply, WhatCannotBeOpenedSaysWhy) {
  TemporaryFolder folder;
  const auto message = [](const std::string& path) -> std::string {
    try {
      const InputFile file(path);
    } catch (const Error& e) {
      EXPECT_EQ(e.kind(), ErrorKind::kIo);
      return e.what();
    }
    return "no error";
  };
  EXPECT_EQ(message(folder / "no.ply"),
            (folder / "no.ply") +
                ": cannot be opened: No such file or directory; check its name and folder");
  EXPECT_EQ(message(folder / "."), (folder / ".") + ": is a directory; name a file");
}

}  // namespace
}  // namespace surfel
