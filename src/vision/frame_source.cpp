#include "helix_arm/vision/frame_source.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <variant>

#include <dlfcn.h>

#include "helix_arm/basics/regular_file.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/localization/camera.hpp"
#include "helix_arm/vision/jpeg.hpp"
#include "media.hpp"

namespace helix_arm::vision {
namespace {

namespace fs = std::filesystem;

// Formats that hold a gray picture without conversion.
constexpr std::array<const char*, 4> kFormats = {"MJPG", "YUYV", "UYVY", "GREY"};

double steadySeconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class CameraSource : public FrameSource {
 public:
  CameraSource(std::unique_ptr<VideoDevice> device, std::string name, double reconnect_after,
               std::function<double()> now)
      : device_(std::move(device)),
        name_(std::move(name)),
        reconnect_after_(reconnect_after),
        now_(std::move(now)) {}

  FrameStatus next(Frame& frame) override {
    begin(frame, name_);
    if (!open_) {
      const double wait = next_try_ - now_();
      if (wait > 0) return fail(frame, fault_, wait);
      if (const auto fault = device_->open()) return lose(frame, *fault);
      open_ = true;
    }
    std::string fault;
    const VideoDevice::Read read = device_->read(frame.gray, fault);
    if (read == VideoDevice::Read::kPicture) return FrameStatus::kFrame;
    if (read == VideoDevice::Read::kBroken) return fail(frame, name_ + ": " + fault);
    return lose(frame, fault);
  }

  bool continuous() const override { return true; }

 private:
  FrameStatus lose(Frame& frame, const std::string& fault) {
    device_->close();
    open_ = false;
    next_try_ = now_() + reconnect_after_;
    fault_ = name_ + ": " + fault;
    return fail(frame, fault_, reconnect_after_);
  }

  std::unique_ptr<VideoDevice> device_;
  std::string name_;
  double reconnect_after_;
  std::function<double()> now_;
  bool open_ = false;
  double next_try_ = -std::numeric_limits<double>::infinity();
  std::string fault_;
};

struct Claim {
  std::uint64_t width = 0, height = 0;
};

// The first bytes of a picture; bytes beyond the end read as 0, which is not a valid size.
class Header {
 public:
  explicit Header(const std::string& bytes) : bytes_(bytes) {}

  bool has(std::size_t place, const char* text) const {
    return place < size() && bytes_.compare(place, std::strlen(text), text) == 0;
  }
  std::uint32_t number(std::size_t place, int count, bool is_big) const {
    std::uint32_t value = 0;
    for (int i = 0; i < count; ++i) value = value << 8 | byte(place + (is_big ? i : count - 1 - i));
    return value;
  }
  std::uint32_t little(std::size_t place, int count) const { return number(place, count, false); }
  std::uint32_t big(std::size_t place, int count) const { return number(place, count, true); }
  const std::uint8_t* data() const { return reinterpret_cast<const std::uint8_t*>(bytes_.data()); }
  std::size_t size() const { return bytes_.size(); }
  std::uint8_t byte(std::size_t place) const { return place < size() ? data()[place] : 0; }

 private:
  const std::string& bytes_;
};

Claim ofBmp(const Header& header) {
  constexpr std::uint32_t kOldHeader = 12;
  if (header.little(14, 4) == kOldHeader) return {header.little(18, 2), header.little(20, 2)};
  // Negative if rows start at the top.
  const auto height = static_cast<std::int32_t>(header.little(22, 4));
  const std::int64_t rows = std::abs(static_cast<std::int64_t>(height));
  return {header.little(18, 4), static_cast<std::uint64_t>(rows)};
}

// Numbers between blanks and comments.
Claim ofPnm(const Header& header) {
  std::array<std::uint64_t, 2> sizes{};
  std::size_t place = 2;
  for (std::uint64_t& size : sizes) {
    while (std::isspace(header.byte(place)) != 0 || header.byte(place) == '#') {
      if (header.byte(place++) != '#') continue;
      while (place < header.size() && header.byte(place) != '\n') ++place;
    }
    constexpr std::uint64_t kEnough = std::numeric_limits<std::uint32_t>::max();
    for (; std::isdigit(header.byte(place)) != 0; ++place) {
      size = std::min(kEnough, 10 * size + (header.byte(place) - '0'));
    }
  }
  return {sizes[0], sizes[1]};
}

Claim ofWebp(const Header& header) {
  if (header.has(12, "VP8X")) return {1ULL + header.little(24, 3), 1ULL + header.little(27, 3)};
  if (header.has(12, "VP8L")) {
    const std::uint32_t sizes = header.little(21, 4);
    return {1ULL + (sizes & 0x3fffU), 1ULL + (sizes >> 14 & 0x3fffU)};
  }
  return {header.little(26, 2) & 0x3fffU, header.little(28, 2) & 0x3fffU};
}

// The first picture; absent if tiles or strips exceed it, or samples are longer than two bytes.
Claim ofTiff(const Header& header) {
  const bool is_big = header.byte(0) == 'M';
  const auto number = [&](std::size_t place, int count) {
    return header.number(place, count, is_big);
  };
  constexpr std::uint32_t kWidth = 256, kHeight = 257, kBits = 258, kSamples = 277, kRows = 278,
                          kTileWidth = 322, kTileHeight = 323, kShort = 3;
  Claim claim;
  std::uint64_t rows = 0, tile_width = 0, tile_height = 0, bits = 1, samples = 1;
  const std::pair<std::uint32_t, std::uint64_t*> fields[] = {
      {kWidth, &claim.width}, {kHeight, &claim.height},  {kSamples, &samples},
      {kRows, &rows},         {kTileWidth, &tile_width}, {kTileHeight, &tile_height}};
  const std::size_t directory = number(4, 4);
  const std::uint32_t entries = directory < header.size() ? number(directory, 2) : 0;
  for (std::uint32_t i = 0; i < entries; ++i) {
    const std::size_t entry = directory + 2 + 12ULL * i;
    const bool is_short = number(entry + 2, 2) == kShort;
    const std::uint32_t value = number(entry + 8, is_short ? 2 : 4);
    const bool is_elsewhere = is_short && number(entry + 4, 4) > 2;
    const std::uint32_t tag = number(entry, 2);
    for (const auto& [known, field] : fields) {
      if (tag == known) *field = value;
    }
    // One per sample; they must be equal, or the decoder refuses the file.
    if (tag == kBits) bits = is_elsewhere ? number(number(entry + 8, 4), 2) : value;
  }
  constexpr std::uint64_t kAllRows = std::numeric_limits<std::uint32_t>::max();
  constexpr std::uint64_t kTile = 1024;  // larger than a small picture
  const bool is_usual =
      bits <= 16 && samples <= 4 && (rows == kAllRows || rows <= std::max(claim.height, kTile)) &&
      tile_width <= std::max(claim.width, kTile) && tile_height <= std::max(claim.height, kTile);
  return is_usual ? claim : Claim{};
}

std::optional<Claim> claimOf(const Header& header) {
  if (header.has(0, "\xff\xd8")) {
    const cv::Size size = JpegDecoder::claimedSize(header.data(), header.size());
    return Claim{static_cast<std::uint64_t>(size.width), static_cast<std::uint64_t>(size.height)};
  }
  if (header.has(0, "\x89PNG\r\n\x1a\n") && header.has(12, "IHDR")) {
    return Claim{header.big(16, 4), header.big(20, 4)};
  }
  if (header.has(0, "BM")) return ofBmp(header);
  if (header.byte(0) == 'P' && header.byte(1) >= '1' && header.byte(1) <= '6') return ofPnm(header);
  if (header.has(0, "RIFF") && header.has(8, "WEBPVP8")) return ofWebp(header);
  if (header.little(0, 4) == 0x002a4949U || header.little(0, 4) == 0x2a004d4dU) {
    return ofTiff(header);
  }
  return std::nullopt;
}

// The size [px] that a picture's header claims, read without decoding: JPEG, PNG, BMP, PNM, TIFF
// and WebP. A decoder of these formats allocates a small multiple of it.
// @return the size, both > 0; or what is wrong with the header.
std::variant<cv::Size, std::string> claimedSize(const Header& header) {
  if (header.size() == 0) return "the file is empty";
  const std::optional<Claim> claim = claimOf(header);
  if (!claim) {
    return "it does not begin like a picture; expected a JPEG, PNG, BMP, PNM, TIFF or WebP";
  }
  constexpr std::uint64_t kMost = std::numeric_limits<int>::max();
  if (claim->width == 0 || claim->height == 0 || claim->width > kMost || claim->height > kMost) {
    return "its header is damaged, truncated or of an unsupported kind";
  }
  return cv::Size(static_cast<int>(claim->width), static_cast<int>(claim->height));
}

constexpr std::size_t kMostBytes = 128U << 20U;  // of a file

std::string sizeText(const cv::Size& size) {
  return std::to_string(size.width) + " x " + std::to_string(size.height);
}

class PictureFiles : public FrameSource {
 public:
  PictureFiles(std::vector<fs::path> paths, std::optional<cv::Size> expected)
      : paths_(std::move(paths)), expected_(expected) {}

  FrameStatus next(Frame& frame) override {
    if (number_ == paths_.size()) return FrameStatus::kEnd;
    begin(frame, paths_[number_].string());
    if (const auto fault = read(frame)) return fail(frame, frame.name + ": " + *fault);
    return FrameStatus::kFrame;
  }

  bool continuous() const override { return false; }

 private:
  // @return the fault; absent on success.
  std::optional<std::string> read(Frame& frame) {
    basics::RegularFile file(frame.name);
    const std::optional<std::string> content = file.readAll(kMostBytes);
    if (!content) return "the file " + file.fault();
    const Header header(*content);
    const std::variant<cv::Size, std::string> claimed = claimedSize(header);
    if (const auto* fault = std::get_if<std::string>(&claimed)) return *fault;
    const cv::Size size = std::get<cv::Size>(claimed);
    if (expected_ && size != *expected_) frame.wrong_size = size;
    if (const auto fault = sizeFault(size, expected_)) return fault;
    const auto fault =
        header.has(0, "\xff\xd8")  ? JpegDecoder().decode(header.data(), header.size(), frame.gray)
        : header.has(0, "\x89PNG") ? decodePng(header.data(), header.size(), frame.gray)
                                   : media().decode(*content, frame.gray);
    if (fault) return fault;
    if (frame.gray.size() != size) return "it is not of the size that its header claims";
    return std::nullopt;
  }

  std::vector<fs::path> paths_;
  std::optional<cv::Size> expected_;
};

constexpr char kLibrary[] = "libhelix_arm_media.so";

const Media& load() {
  void* library = dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  const void* symbol = library == nullptr ? nullptr : dlsym(library, "helix_arm_media");
  if (symbol == nullptr) {
    const char* fault = dlerror();
    throw std::runtime_error(
        std::string("videos, webcams and pictures other than JPEG and PNG need ") + kLibrary +
        ", which does not load: " + (fault == nullptr ? "it is empty" : fault) +
        "; build or install helix_arm again");
  }
  return *static_cast<const Media*>(symbol);
}

constexpr std::array<const char*, 10> kPictures = {".jpg", ".jpeg", ".png", ".bmp",  ".pgm",
                                                   ".ppm", ".pnm",  ".tif", ".tiff", ".webp"};
constexpr std::array<const char*, 8> kVideos = {".avi",  ".mp4", ".mkv", ".mov",
                                                ".webm", ".m4v", ".mpg", ".mjpeg"};

template <std::size_t kSize>
bool hasExtension(const fs::path& path, const std::array<const char*, kSize>& extensions) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(extensions.begin(), extensions.end(), extension) != extensions.end();
}

std::vector<fs::path> picturesIn(const fs::path& folder) {
  std::vector<fs::path> pictures;
  std::error_code error, ignored;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->is_regular_file(ignored) && hasExtension(entry->path(), kPictures)) {
      pictures.push_back(entry->path());
    }
  }
  if (error) throw std::invalid_argument(folder.string() + " cannot be read: " + error.message());
  std::sort(pictures.begin(), pictures.end());
  return pictures;
}

bool equal(const cv::Mat& a, const cv::Mat& b) {
  if (a.empty() || a.size() != b.size() || a.type() != b.type()) return false;
  const std::size_t row = a.elemSize() * static_cast<std::size_t>(a.cols);
  for (int y = 0; y < a.rows; ++y) {
    if (std::memcmp(a.ptr(y), b.ptr(y), row) != 0) return false;
  }
  return true;
}

}  // namespace

void WebcamConfig::validate() const {
  const auto require = [](bool holds, const auto&... parts) {
    basics::require(holds, "webcam ", parts...);
  };
  require(!device.empty(), "device is empty; expected a path such as /dev/video0");
  require(width > 0 && height > 0, "size is ", width, " x ", height, "; expected > 0 px");
  require(std::find(kFormats.begin(), kFormats.end(), fourcc) != kFormats.end(), "fourcc is \"",
          fourcc, "\"; expected one of ", basics::joined(kFormats, " "));
  require(fps > 0 && std::isfinite(fps), "fps is ", fps, "; expected a finite value > 0");
  require(focus >= 0, "focus is ", focus, "; expected >= 0");
  require(exposure >= 0, "exposure is ", exposure, "; expected >= 0");
  require(reconnect_after >= 0 && std::isfinite(reconnect_after), "reconnect_after is ",
          reconnect_after, "; expected a finite value >= 0 s");
}

const Media& media() {
  static const Media& loaded = load();
  return loaded;
}

std::optional<std::string> sizeFault(const cv::Size& size,
                                     const std::optional<cv::Size>& expected) {
  const std::string found = "the picture has " + sizeText(size) + " px; expected ";
  if (expected && size != *expected) return found + sizeText(*expected);
  if (std::max(size.width, size.height) > estimation::Camera::kMaxSide) {
    return found + "at most " + std::to_string(estimation::Camera::kMaxSide) +
           " px per side: make it smaller";
  }
  if (static_cast<std::int64_t>(size.width) * size.height > JpegDecoder::kMaxPixels) {
    return basics::messageOf(found, "at most ", JpegDecoder::kMaxPixels,
                             " pixels: make it smaller");
  }
  return std::nullopt;
}

void FrameSource::begin(Frame& frame, const std::string& name) {
  frame.name = name;
  frame.fault.clear();
  frame.wrong_size.reset();
  frame.retry_after = 0;
  frame.number = number_++;
}

FrameStatus FrameSource::fail(Frame& frame, const std::string& fault, double retry_after) {
  frame.gray.release();
  frame.fault = fault;
  frame.retry_after = retry_after;
  return FrameStatus::kFault;
}

std::unique_ptr<FrameSource> FrameSource::webcam(const WebcamConfig& config) {
  config.validate();
  return camera(media().webcam(config), config.device, config.reconnect_after, steadySeconds);
}

std::unique_ptr<FrameSource> FrameSource::camera(std::unique_ptr<VideoDevice> device,
                                                 const std::string& name, double reconnect_after,
                                                 std::function<double()> now) {
  return std::make_unique<CameraSource>(std::move(device), name, reconnect_after, std::move(now));
}

std::unique_ptr<FrameSource> FrameSource::files(const std::string& path,
                                                std::optional<cv::Size> expected) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    std::vector<fs::path> pictures = picturesIn(path);
    basics::require(!pictures.empty(), path, " holds no pictures; expected files ending in ",
                    basics::joined(kPictures, " "));
    return std::make_unique<PictureFiles>(std::move(pictures), expected);
  }
  const bool is_file = fs::is_regular_file(path, error);
  basics::require(is_file, path, " is neither a file nor a folder",
                  error ? ": " + error.message() : "");
  if (hasExtension(path, kPictures)) {
    return std::make_unique<PictureFiles>(std::vector<fs::path>{path}, expected);
  }
  if (hasExtension(path, kVideos)) return media().video(path, expected);
  throw std::invalid_argument(path + " is neither a picture (" + basics::joined(kPictures, " ") +
                              ") nor a video (" + basics::joined(kVideos, " ") + ")");
}

bool FrozenWatch::isFrozen(const cv::Mat& gray, const Eigen::Vector3d& model_tip) {
  if (equal(gray, before_)) return (model_tip - tip_).norm() > kMotion;
  gray.copyTo(before_);
  tip_ = model_tip;
  return false;
}

}  // namespace helix_arm::vision
