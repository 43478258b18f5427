// Any bytes as a JPEG and as a PNG: a picture of the size that its header claims, or a fault that
// says why not, and no picture. The sanitizers do not see into libjpeg-turbo and libpng: what they
// read and write is guarded by pages that may not be touched.
#include <algorithm>
#include <new>

#include <opencv2/core.hpp>
#include <sys/mman.h>
#include <unistd.h>

#include "helix_arm/vision/jpeg.hpp"
#include "memory_file.hpp"
#include "vision/media.hpp"

namespace {

using namespace helix_arm;
using test::demand;

constexpr std::size_t kMostPixels = 1U << 22U;

// Memory behind whose end a page follows that ends the process when it is read or written.
class GuardedMemory {
 public:
  explicit GuardedMemory(std::size_t capacity) {
    const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
    const std::size_t usable = (capacity + page - 1) / page * page;
    void* const begin =
        mmap(nullptr, usable + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (begin == MAP_FAILED) throw std::bad_alloc();
    end_ = static_cast<std::uint8_t*>(begin) + usable;
    if (mprotect(end_, page, PROT_NONE) != 0) throw std::bad_alloc();
  }
  // The last bytes of it.
  std::uint8_t* last(std::size_t bytes) const { return end_ - bytes; }

 private:
  std::uint8_t* end_;
};

// As a PNG's header has it; empty where there is none.
cv::Size pngSize(const std::uint8_t* data, std::size_t size) {
  const auto number = [data](int at) {
    std::uint32_t out = 0;
    for (int i = at; i < at + 4; ++i) out = out << 8U | data[i];
    return static_cast<int>(out);
  };
  return size < 24 ? cv::Size() : cv::Size(number(16), number(20));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  constexpr std::size_t kMostBytes = 1U << 20U;
  static const GuardedMemory input(kMostBytes), output(kMostPixels);
  if (size > kMostBytes) return 0;
  std::uint8_t* const data = input.last(size);
  std::copy_n(bytes, size, data);
  for (const bool png : {false, true}) {
    const cv::Size claimed =
        png ? pngSize(data, size) : vision::JpegDecoder::claimedSize(data, size);
    const bool fits =
        claimed.width > 0 && claimed.height > 0 &&
        static_cast<std::size_t>(claimed.width) * static_cast<std::size_t>(claimed.height) <=
            kMostPixels;
    if (png && !fits) continue;  // the caller has looked at its size
    cv::Mat gray;                // goes where there is room for it, and for nothing more
    if (fits)
      gray = cv::Mat(claimed, CV_8UC1, output.last(static_cast<std::size_t>(claimed.area())));
    const auto fault =
        png ? vision::decodePng(data, size, gray) : vision::JpegDecoder().decode(data, size, gray);
    demand(fault ? !fault->empty() && gray.empty()
                 : gray.size() == claimed && gray.type() == CV_8UC1);
  }
  return 0;
}
