// Built with the decoder and the sanitizers for addresses and undefined behaviour.
#include <algorithm>
#include <iostream>
#include <memory>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "helix_arm/vision/jpeg.hpp"
#include "jpeg_pictures.hpp"
#include "support/random.hpp"

namespace helix_arm::test {
namespace {

constexpr int kStrings = 100'000;

std::vector<Bytes> soundPictures() {
  std::vector<Bytes> pictures;
  const cv::Mat colour = colourPicture(37, 29);
  for (const int subsampling : {TJSAMP_GRAY, TJSAMP_422, TJSAMP_420}) {
    for (const int flags : {0, TJFLAG_PROGRESSIVE}) {
      pictures.push_back(jpegOf(colour, TJPF_BGR, subsampling, 70, flags));
    }
  }
  return pictures;
}

std::uint8_t randomByte(Random& random) {
  return static_cast<std::uint8_t>(random.integer(0, 255));
}

// Nothing but chance; or chance after a sound beginning; or a sound picture with some bits turned
// over, bytes cut out, or its end cut off.
Bytes mangled(const std::vector<Bytes>& sound, Random& random) {
  Bytes bytes;
  const int kind = random.integer(0, 4);
  if (kind > 0)
    bytes = sound[static_cast<std::size_t>(random.integer(0, static_cast<int>(sound.size()) - 1))];
  const auto place = [&] { return random.integer(0, static_cast<int>(bytes.size()) - 1); };
  switch (kind) {
    case 0:
      bytes.resize(static_cast<std::size_t>(random.integer(0, 600)));
      std::generate(bytes.begin(), bytes.end(), [&] { return randomByte(random); });
      break;
    case 1:
      std::generate(bytes.begin() + place(), bytes.end(), [&] { return randomByte(random); });
      break;
    case 2:
      for (int i = random.integer(1, 12); i > 0; --i) {
        bytes[static_cast<std::size_t>(place())] ^=
            static_cast<std::uint8_t>(1 << random.integer(0, 7));
      }
      break;
    case 3: {
      const int from = place();
      bytes.erase(bytes.begin() + from,
                  bytes.begin() +
                      std::min<int>(from + random.integer(1, 40), static_cast<int>(bytes.size())));
      break;
    }
    default:
      bytes.resize(static_cast<std::size_t>(place()));
  }
  return bytes;
}

// The size in the frame header: what an accepted picture must have.
cv::Size claimedSize(const Bytes& bytes) {
  const tjhandle codec = tjInitDecompress();
  int width = 0, height = 0, subsampling = 0, colours = 0;
  tjDecompressHeader3(codec, bytes.data(), bytes.size(), &width, &height, &subsampling, &colours);
  tjDestroy(codec);
  return {width, height};
}

TEST(JpegFuzz, NoBytesCrashTheDecoderAndNoPictureIsMadeUp) {
  const std::vector<Bytes> sound = soundPictures();
  Random random(2024);
  vision::JpegDecoder decoder;
  cv::Mat gray;
  int accepted = 0, refused = 0;
  for (int i = 0; i < kStrings; ++i) {
    // No byte beyond the last may be read: the heap's red zone begins there.
    const Bytes bytes = mangled(sound, random);
    const auto exact = std::make_unique<std::uint8_t[]>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), exact.get());
    const auto fault = decoder.decode(exact.get(), bytes.size(), gray);
    if (fault) {
      ++refused;
      ASSERT_FALSE(fault->empty());
      ASSERT_TRUE(gray.empty());
      continue;
    }
    ++accepted;
    ASSERT_EQ(gray.size(), claimedSize(bytes));
    ASSERT_EQ(gray.type(), CV_8UC1);
  }
  std::cout << accepted << " accepted, " << refused << " refused\n";
  EXPECT_GT(accepted, kStrings / 100) << "turned bits in the middle of a scan leave sound pictures";
  EXPECT_GT(refused, kStrings / 2);
}

}  // namespace
}  // namespace helix_arm::test
