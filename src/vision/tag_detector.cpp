#include "helix_arm/vision/tag_detector.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <tuple>

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>

#include "basics/text.hpp"
#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/localization/camera.hpp"
#include "tag_tracker.hpp"

namespace helix_arm::vision {
namespace {

using basics::require;
using estimation::Camera;

struct Maker {
  const char* name;
  apriltag_family_t* (*create)();
  void (*destroy)(apriltag_family_t*);
};

constexpr std::array<Maker, 9> kMakers = {{
    {"36h11", tag36h11_create, tag36h11_destroy},
    {"25h9", tag25h9_create, tag25h9_destroy},
    {"16h5", tag16h5_create, tag16h5_destroy},
    {"36h10", tag36h10_create, tag36h10_destroy},
    {"Circle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
    {"Circle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
    {"Custom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
    {"Standard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
    {"Standard52h13", tagStandard52h13_create, tagStandard52h13_destroy},
}};

std::shared_ptr<apriltag_family> make(const std::string& name) {
  for (const Maker& maker : kMakers) {
    if (name == maker.name) return {maker.create(), maker.destroy};
  }
  throw std::invalid_argument("tag family is \"" + name + "\"; expected one of " +
                              basics::joined(TagFamily::names()));
}

// libapriltag does not export its own function.
void freeImage(image_u8_t* image) {
  std::free(image->buf);
  std::free(image);
}

constexpr int kMaxDecimate = 32;
constexpr double kMaxTableBytes = 2147483648;  // memory for wrong bits
constexpr int kTile = 4;                       // of libapriltag's threshold [px]

// libapriltag tabulates every word that differs from a code in at most this number of bits.
double tableBytes(const TagFamily& family, int wrong_bits) {
  constexpr double kBytesPerWord = 48;
  double words = 1, sum = 1;
  for (int i = 0; i < wrong_bits; ++i) sum += words *= family.bitCount() - i;
  return kBytesPerWord * family.count() * sum;
}

}  // namespace

TagFamily::TagFamily(const std::string& name) : name_(name), family_(make(name)) {}

std::vector<std::string> TagFamily::names() {
  std::vector<std::string> names;
  for (const Maker& maker : kMakers) names.emplace_back(maker.name);
  return names;
}

int TagFamily::count() const { return static_cast<int>(family_->ncodes); }

int TagFamily::bitCount() const { return static_cast<int>(family_->nbits); }

int TagFamily::distance() const { return static_cast<int>(family_->h); }

cv::Mat TagFamily::cells(int id) const {
  if (id < 0 || id >= count()) {
    throw std::out_of_range("tag id is " + std::to_string(id) + "; family " + name_ + " has 0 to " +
                            std::to_string(count() - 1));
  }
  const std::unique_ptr<image_u8_t, void (*)(image_u8_t*)> image(
      apriltag_to_image(family_.get(), id), freeImage);
  return cv::Mat(image->height, image->width, CV_8UC1, image->buf, image->stride).clone();
}

int TagFamily::quietCells() const { return (family_->total_width - family_->width_at_border) / 2; }

int TagFamily::borderCells() const { return family_->width_at_border; }

std::string TagFamily::sizeEdge() const {
  return isReversed() ? "inner edge of the black ring, where it meets the white square inside it"
                      : "outer edge of the black border, where it meets the white around it";
}

bool TagFamily::isReversed() const { return family_->reversed_border; }

void DetectorConfig::validate() const {
  const TagFamily of(family);
  require(quad_decimate == 1.5 || (quad_decimate >= 1 && quad_decimate <= kMaxDecimate &&
                                   quad_decimate == std::floor(quad_decimate)),
          "quad_decimate is ", quad_decimate, "; expected 1, 1.5 or a whole number up to ",
          kMaxDecimate);
  require(2 * max_hamming < of.distance(), "max_hamming is ", max_hamming, "; tags of ", family,
          " differ in ", of.distance(), " bits, so that no more than ", (of.distance() - 1) / 2,
          " can be corrected");
  require(tableBytes(of, max_hamming) <= kMaxTableBytes, "max_hamming is ", max_hamming,
          ", which takes ", tableBytes(of, max_hamming) / 1e9, " GB for the ", of.count(),
          " tags of ", family, "; expected at most ", kMaxTableBytes / 1e9, " GB: lower it");
}

TagDetector::TagDetector(const DetectorConfig& config)
    : config_((config.validate(), config)),
      family_(config.family),
      detector_(apriltag_detector_create(), [family = family_](apriltag_detector_t* detector) {
        apriltag_detector_destroy(detector);
      }) {
  apriltag_detector_add_family_bits(detector_.get(), family_.get(), config.max_hamming);
  detector_->quad_decimate = static_cast<float>(config.quad_decimate);
  detector_->quad_sigma = static_cast<float>(config.quad_sigma);
  detector_->nthreads = config.threads;
  // At full size, libapriltag's refinement makes quads worse and fewer tags are decoded. With a
  // reduced picture, more are decoded.
  detector_->refine_edges = config.refine_edges && config.quad_decimate > 1;
}

// Smallest side of a picture before decimation: libapriltag reads beyond the memory of pictures
// smaller than a tile or, if it blurs, the kernel.
int TagDetector::leastSide() const {
  const int kernel = static_cast<int>(4 * std::abs(config_.quad_sigma)) | 1;
  return static_cast<int>(std::ceil(config_.quad_decimate)) * std::max(kTile, kernel);
}

std::vector<TagDetection> TagDetector::detect(const cv::Mat& gray, const cv::Rect& region) {
  if (gray.empty()) return {};
  require(gray.type() == CV_8UC1, "the picture is of type ", cv::typeToString(gray.type()),
          "; expected gray of 8 bits, CV_8UC1");
  // libapriltag aborts on larger pictures.
  require(std::max(gray.cols, gray.rows) <= Camera::kMaxSide, "the picture has ", gray.cols, " x ",
          gray.rows, " px; expected at most ", Camera::kMaxSide, " px per side");
  // If the region starts on the grid of the whole picture, the same quads are found.
  const int grid = static_cast<int>(std::lround(kTile * config_.quad_decimate));
  cv::Rect inside = region & cv::Rect({0, 0}, gray.size());
  if (inside.empty()) return {};
  inside += cv::Size(inside.x % grid, inside.y % grid);
  inside -= cv::Point(inside.x % grid, inside.y % grid);
  std::vector<TagDetection> tags;
  cv::Mat searched = gray(inside);
  const int right = std::max(0, leastSide() - inside.width);
  const int below = std::max(0, leastSide() - inside.height);
  if (right > 0 || below > 0) {
    cv::copyMakeBorder(searched, copy_, 0, below, 0, right,
                       cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
    searched = copy_;
  } else if (config_.quad_decimate == 1 && config_.quad_sigma != 0) {
    searched.copyTo(copy_);  // libapriltag would blur the caller's picture
    searched = copy_;
  }
  image_u8_t image{searched.cols, searched.rows, static_cast<int>(searched.step[0]), searched.data};
  const std::unique_ptr<zarray_t, void (*)(zarray_t*)> found(
      apriltag_detector_detect(detector_.get(), &image), apriltag_detections_destroy);
  tags.reserve(zarray_size(found.get()));
  for (int i = 0; i < zarray_size(found.get()); ++i) {
    const apriltag_detection_t* tag = nullptr;
    zarray_get(found.get(), i, &tag);
    TagDetection& out = tags.emplace_back();
    out.id = tag->id;
    out.hamming = tag->hamming;
    out.margin = tag->decision_margin;
    for (int k = 0; k < 4; ++k) {
      // libapriltag has pixel centres at .5.
      out.corners.col(k) << tag->p[k][0] - 0.5 + inside.x, tag->p[k][1] - 0.5 + inside.y;
    }
    if (config_.refine_edges) {
      out.corners = refineCorners(gray, family_, 1 + config_.quad_decimate, out.corners);
    }
  }
  const auto key = [](const TagDetection& tag) {
    return std::make_tuple(tag.id, tag.corners(0, 0), tag.corners(1, 0));
  };
  std::sort(tags.begin(), tags.end(),
            [&key](const TagDetection& a, const TagDetection& b) { return key(a) < key(b); });
  return tags;
}

}  // namespace helix_arm::vision
