// Photographs of real tags, as they are and with one of the tags mirrored, copied or exchanged with
// another: no shape may come of it that is silently wrong. Of few tags, two that are exchanged may
// be explained by another shape of the arm: nothing but large residuals tells that.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <optional>
#include <ostream>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "helix_arm/model/curve.hpp"
#include "helix_arm/vision/arm_localizer.hpp"
#include "helix_arm/vision/tag_detector.hpp"
#include "support/test_size.hpp"
#include "vision/frame_source.hpp"

namespace helix_arm::test {
namespace {

using estimation::Corners;
using namespace vision;
namespace fs = std::filesystem;

// Photographs with licences of their own, which are not part of the project: where they are absent
// there is nothing to test.
fs::path photographs(const std::string& folder) {
  return fs::path(HELIX_ARM_SOURCE_DIR) / ".." / "shared" / "data" / "real_tags" / folder;
}

// Gray pictures of a folder by their names.
std::map<std::string, cv::Mat> picturesIn(const fs::path& folder) {
  std::map<std::string, cv::Mat> pictures;
  const auto source = vision::FrameSource::files(folder.string());
  vision::Frame frame;
  while (source->next(frame) != vision::FrameStatus::kEnd) {
    EXPECT_EQ(frame.fault, "");
    pictures[fs::path(frame.name).filename().string()] = frame.gray.clone();
  }
  return pictures;
}

// How many tags of family 36h11 libapriltag finds by itself, with its own defaults.
int plainCount(const cv::Mat& picture, double decimate) {
  apriltag_family_t* family = tag36h11_create();
  apriltag_detector_t* detector = apriltag_detector_create();
  apriltag_detector_add_family(detector, family);
  detector->quad_decimate = static_cast<float>(decimate);
  image_u8_t image{picture.cols, picture.rows, static_cast<int>(picture.step[0]), picture.data};
  zarray_t* found = apriltag_detector_detect(detector, &image);
  const int count = zarray_size(found);
  apriltag_detections_destroy(found);
  apriltag_detector_destroy(detector);
  tag36h11_destroy(family);
  return count;
}

// Of a file with `id, (x y), (x y), (x y), (x y)` a line: what libapriltag said, but with the
// centres of pixels at whole numbers [px].
std::vector<std::pair<int, Corners>> cornersOf(const fs::path& path) {
  std::vector<std::pair<int, Corners>> tags;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    for (char& c : line) {
      if (c == ',' || c == '(' || c == ')') c = ' ';
    }
    std::istringstream words(line);
    int id = 0;
    Corners corners;
    if (!(words >> id)) continue;
    for (int k = 0; k < 4; ++k) words >> corners(0, k) >> corners(1, k);
    EXPECT_TRUE(words) << path << ": " << line;
    tags.emplace_back(id, corners.array() - 0.5);
  }
  return tags;
}

constexpr double kTagSize = 0.031;  // that of an arm: the rooms shrink to its scale [m]
constexpr double kWrong = 0.03;     // of the tip; tags are at least 0.1 m apart [m]
constexpr double kTelling = 1.0;    // residuals that tell a wrong fit; sound ones: below 0.3 [px]

// From the plane of a tag, whose black square has its corners at +-1, to the picture.
cv::Matx33d toPicture(const Corners& corners) {
  const cv::Point2f square[4] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
  cv::Point2f seen[4];
  for (int k = 0; k < 4; ++k) {
    seen[k] = {static_cast<float>(corners(0, k)), static_cast<float>(corners(1, k))};
  }
  return cv::getPerspectiveTransform(square, seen);
}

// Pastes the tag that is at `from`, with the cell of white around it, over the place `to`.
void paste(const cv::Mat& photograph, const Corners& from, const Corners& to, bool mirrored,
           cv::Mat& out) {
  constexpr float kOutline = 10.0F / 8;
  const cv::Matx33d flip(mirrored ? -1 : 1, 0, 0, 0, 1, 0, 0, 0, 1);
  const cv::Matx33d place = toPicture(to);
  cv::Mat moved;
  cv::warpPerspective(photograph, moved, place * flip * toPicture(from).inv(), photograph.size(),
                      cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  const std::vector<cv::Point2f> outline = {
      {-kOutline, -kOutline}, {kOutline, -kOutline}, {kOutline, kOutline}, {-kOutline, kOutline}};
  std::vector<cv::Point2f> seen;
  cv::perspectiveTransform(outline, seen, place);
  const std::vector<cv::Point> pixels(seen.begin(), seen.end());
  cv::Mat mask(photograph.size(), CV_8UC1, cv::Scalar(0));
  cv::fillConvexPoly(mask, pixels, cv::Scalar(255));
  moved.copyTo(out, mask);
}

// A tag seen from the camera, by OpenCV.
lie::SE3 poseOf(const estimation::ArmView& view, const Corners& corners) {
  const Corners square = view.layout.corners();
  const Corners seen = estimation::directionsOf(view.camera, corners).value();
  std::vector<cv::Point3d> object;
  std::vector<cv::Point2d> picture;
  for (int k = 0; k < 4; ++k) {
    object.emplace_back(square(0, k), square(1, k), 0);
    picture.emplace_back(seen(0, k), seen(1, k));
  }
  cv::Vec3d turn, place;
  cv::solvePnP(object, picture, cv::Matx33d::eye(), cv::noArray(), turn, place);
  const Eigen::Vector3d r(turn[0], turn[1], turn[2]);
  return {Eigen::AngleAxisd(r.norm(), r.stableNormalized()).toRotationMatrix(),
          Eigen::Vector3d(place[0], place[1], place[2])};
}

// A straight arm through the room, from left to right, that carries the tags of a photograph where
// they are.
struct RoomArm {
  estimation::ArmView view;
  model::Twists twists = model::Twists::Zero(6, 1);

  explicit RoomArm(const std::vector<TagDetection>& tags) {
    constexpr double kMargin = 0.05;  // from the base to the first tag [m]
    // The photographs' source gives this camera.
    view.camera = {816, 612, 765.00, 764.18, 393.72, 304.66, {}};
    view.layout.size = kTagSize;
    std::vector<lie::SE3> X_CT;
    for (const TagDetection& tag : tags) X_CT.push_back(poseOf(view, tag.corners));
    const auto x = [](const lie::SE3& pose) { return pose.translation.x(); };
    const auto [first, last] = std::minmax_element(
        X_CT.begin(), X_CT.end(), [&x](const auto& a, const auto& b) { return x(a) < x(b); });
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const lie::SE3& pose : X_CT) middle += pose.translation / X_CT.size();
    const double length = kMargin + x(*last) - x(*first);
    twists(0, 0) = length;
    view.X_CB.rotation.setIdentity();
    view.X_CB.translation << x(*first) - kMargin, middle.y(), middle.z();
    for (std::size_t i = 0; i < tags.size(); ++i) {
      const double s = std::clamp((x(X_CT[i]) - view.X_CB.translation.x()) / length, 0.0, 1.0);
      lie::SE3 X_CS = view.X_CB;
      X_CS.translation.x() += s * length;
      view.layout.tags.push_back({tags[i].id, 0, s, X_CS.inverse() * X_CT[i]});
    }
  }
  Eigen::Vector3d tip() const { return model::tipPose(twists).translation; }
};

struct Photograph {
  const char* name;
  cv::Point bare;    // the middle of a place with nothing on it
  std::size_t tags;  // fewest that are found
};
void PrintTo(const Photograph& photograph, std::ostream* out) { *out << photograph.name; }

class AlteredPhotograph : public ::testing::TestWithParam<Photograph> {
 protected:
  void SetUp() override {
    const fs::path folder = photographs("swat_mapping");
    if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
    photograph_ = picturesIn(folder).at(GetParam().name);
    config_.detector.quad_decimate = 1;
    tags_ = vision::TagDetector(config_.detector).detect(photograph_);
    ASSERT_GE(tags_.size(), GetParam().tags);
    arm_.emplace(tags_);
    // As it was taken it is measured, with all its tags.
    const Observation observation =
        ArmLocalizer(arm_->view, config_).locate(photograph_, arm_->twists);
    ASSERT_EQ(observation.state, ObservationState::kMeasured);
    EXPECT_EQ(observation.fit.tags.size(), tags_.size());
    EXPECT_EQ(observation.fit.outliers(), 0);
    EXPECT_LT(tipError(observation), kWrong / 3);
  }

  double tipError(const Observation& observation) const {
    return (model::tipPose(observation.fit.shape).translation - arm_->tip()).norm();
  }
  static std::vector<int> idsOf(const std::vector<TagDetection>& tags) {
    std::vector<int> ids;
    for (const TagDetection& tag : tags) ids.push_back(tag.id);
    return ids;
  }

  // Looks for the arm in a picture, as the first one and after the photograph: in the latter case
  // the tags are tracked. Gives what was seen in the first one.
  Observation expectNotFooled(const cv::Mat& picture, const std::vector<int>& wrong,
                              const std::string& what) {
    ArmLocalizer tracking(arm_->view, config_);
    tracking.locate(photograph_, arm_->twists);
    expectSound(tracking.locate(picture, arm_->twists), wrong, what + ", tracked");
    const Observation first = ArmLocalizer(arm_->view, config_).locate(picture, arm_->twists);
    EXPECT_TRUE(first.whole_picture);
    expectSound(first, wrong, what);
    ++(first.state == ObservationState::kMeasured ? measured_ : refused_);
    return first;
  }
  void expectSound(const Observation& observation, const std::vector<int>& wrong,
                   const std::string& what) {
    if (observation.state != ObservationState::kMeasured) return;
    const auto isWrong = [&](const estimation::TagResidual& tag) {
      const int id = arm_->view.layout.tags[static_cast<std::size_t>(tag.tag)].id;
      return std::find(wrong.begin(), wrong.end(), id) != wrong.end() && !tag.outlier;
    };
    const bool counts =
        std::any_of(observation.fit.tags.begin(), observation.fit.tags.end(), isWrong);
    if (!counts && tipError(observation) < kWrong) {
      EXPECT_LT(observation.fit.rms, kTelling) << what;
      return;
    }
    std::printf("[  FIGURE  ] %s: the tip is %.0f mm off, residuals %.2f px\n", what.c_str(),
                1e3 * tipError(observation), observation.fit.rms);
    EXPECT_GT(observation.fit.rms, kTelling) << what;
    fooled_.insert(what.substr(0, what.find(',')));
  }
  void print(const char* what) const {
    std::printf("[  FIGURE  ] %s, %zu tags, %s: measured %d times, refused %d, wrong %zu\n",
                GetParam().name, tags_.size(), what, measured_, refused_, fooled_.size());
  }

  cv::Mat photograph_;
  vision::LocalizerConfig config_;
  std::vector<TagDetection> tags_;
  std::optional<RoomArm> arm_;
  int measured_ = 0, refused_ = 0;
  std::set<std::string> fooled_;
};

TEST_P(AlteredPhotograph, AMirroredTagIsNoTag) {
  for (const TagDetection& tag : tags_) {
    cv::Mat picture = photograph_.clone();
    paste(photograph_, tag.corners, tag.corners, true, picture);
    const Observation observation =
        expectNotFooled(picture, {tag.id}, "tag " + std::to_string(tag.id) + " mirrored");
    std::vector<int> others = idsOf(tags_);
    others.erase(std::find(others.begin(), others.end(), tag.id));
    EXPECT_EQ(idsOf(observation.detections), others);
  }
  print("one mirrored");
  EXPECT_TRUE(fooled_.empty());
}

TEST_P(AlteredPhotograph, ATagThatIsThereTwiceIsNamedAndNotUsed) {
  for (const TagDetection& tag : tags_) {
    // By whole pixels, so that the copy is as sharp.
    const Eigen::Vector2d middle = tag.corners.rowwise().mean();
    const Eigen::Vector2d motion =
        (Eigen::Vector2d(GetParam().bare.x, GetParam().bare.y) - middle).array().round();
    cv::Mat picture = photograph_.clone();
    paste(photograph_, tag.corners, tag.corners.colwise() + motion, false, picture);
    // While it is tracked, the copy is not looked for, and the tag counts where it is.
    const Observation observation =
        expectNotFooled(picture, {}, "tag " + std::to_string(tag.id) + " copied");
    EXPECT_EQ(observation.repeated_ids, std::vector<int>{tag.id});
    if (observation.state != ObservationState::kMeasured) continue;
    EXPECT_EQ(observation.fit.tags.size(), tags_.size() - 1);
  }
  print("one copied");
  EXPECT_TRUE(fooled_.empty());
}

TEST_P(AlteredPhotograph, TagsThatAreExchangedDoNotCount) {
  int pairs = 0, found = 0;
  for (const TagDetection& one : tags_) {
    for (const TagDetection& other : tags_) {
      if (one.id >= other.id) continue;
      cv::Mat picture = photograph_.clone();
      paste(photograph_, one.corners, other.corners, false, picture);
      paste(photograph_, other.corners, one.corners, false, picture);
      const Observation observation = expectNotFooled(
          picture, {one.id, other.id},
          "tags " + std::to_string(one.id) + " and " + std::to_string(other.id) + " exchanged");
      const auto isAt = [&observation](int id, const Corners& place) {
        return std::any_of(observation.detections.begin(), observation.detections.end(),
                           [&](const TagDetection& tag) {
                             return tag.id == id &&
                                    (tag.corners - place).colwise().norm().maxCoeff() < 3;
                           });
      };
      ++pairs;
      found += isAt(one.id, other.corners) && isAt(other.id, one.corners) ? 1 : 0;
    }
  }
  print("two exchanged");
  EXPECT_LE(3 * fooled_.size(), static_cast<std::size_t>(pairs));
  // Else nothing would have been tried: tags are found where they were pasted.
  EXPECT_GT(found, 0);
}

// By default the first.
std::vector<Photograph> photographsToAlter() {
  std::vector<Photograph> all = {{"IMG_1384.JPG", {340, 300}, 3},
                                 {"IMG_1415.JPG", {640, 240}, 3},
                                 {"IMG_1451.JPG", {180, 110}, 6}};
  if (!isFullSize()) all.resize(1);
  return all;
}

INSTANTIATE_TEST_SUITE_P(Rooms, AlteredPhotograph, ::testing::ValuesIn(photographsToAlter()),
                         [](const auto& photograph) {
                           return std::string(photograph.param.name, 8);
                         });

TEST(RealTags, CornersAreThoseOfTheReference) {
  const fs::path folder = photographs("april_swarmathon");
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is absent";
  const auto pictures = picturesIn(folder);
  ASSERT_EQ(pictures.size(), 3u);
  for (const double decimate : {1.0, 2.0}) {
    DetectorConfig config;
    config.quad_decimate = decimate;
    TagDetector detector(config);
    double sum = 0;
    int found = 0, plain = 0, all = 0;
    for (const auto& [name, picture] : pictures) {
      auto truth = cornersOf((folder / name).replace_extension(".txt"));
      all += static_cast<int>(truth.size());
      plain += plainCount(picture, decimate);
      for (const TagDetection& tag : detector.detect(picture)) {
        const auto near = std::find_if(truth.begin(), truth.end(), [&](const auto& entry) {
          return entry.first == tag.id &&
                 (entry.second - tag.corners).colwise().norm().maxCoeff() < 3;
        });
        ASSERT_NE(near, truth.end()) << name << " holds no tag " << tag.id << " there";
        sum += (near->second - tag.corners).squaredNorm() / 8;
        truth.erase(near);
        ++found;
      }
    }
    ASSERT_GT(found, 0);
    EXPECT_GE(found, plain);
    const double rms = std::sqrt(sum / found);
    std::cout << "decimate " << decimate << ": " << found << " of " << all
              << " tags, libapriltag by itself " << plain << ", corners " << rms << " px RMS\n";
    EXPECT_LE(rms, 0.3);
  }
}

}  // namespace
}  // namespace helix_arm::test
