// Built with the decoder and the sanitizers for addresses and undefined behaviour. They do not see
// into libjpeg-turbo, which is built without them: what it reads and writes is guarded by pages
// that may not be touched.
#include <algorithm>
#include <iostream>
#include <new>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>
#include <sys/mman.h>
#include <unistd.h>

#include "helix_arm/vision/jpeg.hpp"
#include "jpeg_pictures.hpp"
#include "mangled.hpp"

namespace helix_arm::test {
namespace {

constexpr int kStrings = 100'000;

/// Memory behind whose end a page follows that ends the process when it is read or written.
class GuardedMemory {
 public:
  explicit GuardedMemory(std::size_t least_capacity) {
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    capacity_ = (least_capacity + page - 1) / page * page;
    mapped_ = capacity_ + page;
    begin_ = mmap(nullptr, mapped_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (begin_ == MAP_FAILED) throw std::bad_alloc();
    if (mprotect(end(), page, PROT_NONE) != 0) throw std::bad_alloc();
  }
  ~GuardedMemory() { munmap(begin_, mapped_); }
  GuardedMemory(const GuardedMemory&) = delete;
  GuardedMemory& operator=(const GuardedMemory&) = delete;

  std::size_t capacity() const { return capacity_; }
  std::uint8_t* end() const { return static_cast<std::uint8_t*>(begin_) + capacity_; }
  /// The last bytes of it.
  std::uint8_t* last(std::size_t bytes) const { return end() - bytes; }

 private:
  std::size_t capacity_, mapped_;
  void* begin_;
};

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

// The size in the frame header: what an accepted picture must have.
cv::Size claimedSize(const Bytes& bytes) {
  const tjhandle codec = tjInitDecompress();
  int width = 0, height = 0, subsampling = 0, colours = 0;
  tjDecompressHeader3(codec, bytes.data(), bytes.size(), &width, &height, &subsampling, &colours);
  tjDestroy(codec);
  return {width, height};
}

TEST(JpegFuzzDeathTest, TheGuardEndsAProcessBeyondItsLimits) {
  const GuardedMemory memory(100);
  *memory.last(1) = 7;
  EXPECT_DEATH(*memory.end() = 7, "SEGV");
  EXPECT_DEATH(std::cout << *memory.end(), "SEGV");
}

TEST(JpegFuzz, NoBytesCrashTheDecoderAndNoPictureIsMadeUp) {
  const std::vector<Bytes> sound = soundPictures();
  Random random(2024);
  vision::JpegDecoder decoder;
  const GuardedMemory input(1U << 16U), output(1U << 24U);
  int accepted = 0, refused = 0;
  for (int i = 0; i < kStrings; ++i) {
    const Bytes bytes = mangled(sound, random);
    ASSERT_LE(bytes.size(), input.capacity());
    std::uint8_t* const data = input.last(bytes.size());
    std::copy(bytes.begin(), bytes.end(), data);
    // The picture goes where there is room for it, and for nothing more.
    const cv::Size size = claimedSize(bytes);
    const std::size_t pixels = static_cast<std::size_t>(size.width) * size.height;
    const bool guarded = pixels > 0 && pixels <= output.capacity();
    cv::Mat gray;
    if (guarded) gray = cv::Mat(size, CV_8UC1, output.last(pixels));
    const auto fault = decoder.decode(data, bytes.size(), gray);
    if (fault) {
      ++refused;
      ASSERT_FALSE(fault->empty());
      ASSERT_TRUE(gray.empty());
      continue;
    }
    ++accepted;
    ASSERT_EQ(gray.size(), size);
    ASSERT_EQ(gray.type(), CV_8UC1);
    ASSERT_TRUE(guarded);
    ASSERT_EQ(gray.data, output.last(pixels));
  }
  std::cout << accepted << " accepted, " << refused << " refused\n";
  EXPECT_GT(accepted, kStrings / 100) << "turned bits in the middle of a scan leave sound pictures";
  EXPECT_GT(refused, kStrings / 2);
}

}  // namespace
}  // namespace helix_arm::test
