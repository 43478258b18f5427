#include "helix_arm/vision/tag_family.hpp"

#include <array>
#include <cstdlib>
#include <stdexcept>

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

namespace helix_arm::vision {
namespace {

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
  std::string known;
  for (const Maker& maker : kMakers) {
    if (name == maker.name) return {maker.create(), maker.destroy};
    known += (known.empty() ? "" : ", ") + std::string(maker.name);
  }
  throw std::invalid_argument("tag family is \"" + name + "\"; expected one of " + known);
}

// libapriltag does not export its own function.
void freeImage(image_u8_t* image) {
  std::free(image->buf);
  std::free(image);
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

bool TagFamily::isReversed() const { return family_->reversed_border; }

}  // namespace helix_arm::vision
