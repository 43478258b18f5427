#include "helix_arm/simulation/camera.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <random>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "tag_painter.hpp"

namespace helix_arm::simulation {
namespace {

constexpr double kEdge = 0.5;  // of white around a board [squares]

}  // namespace

double CardPrint::width() const { return std::accumulate(across.begin(), across.end(), 0.0); }

double CardPrint::height() const { return std::accumulate(down.begin(), down.end(), 0.0); }

CardPrint tagPrint(const vision::TagFamily& family, int id, double size) {
  CardPrint print{family.cells(id), {}, {}, size / family.borderCells()};
  print.across.assign(static_cast<std::size_t>(print.cells.cols), 1.0);
  print.down.assign(static_cast<std::size_t>(print.cells.rows), 1.0);
  return print;
}

CardPrint charucoPrint(const vision::CharucoBoard& board) {
  const int bits = vision::markerDictionary(board.dictionary).bits + 2;
  const int cells = bits + 2;  // of a square: those of a marker and what is around it
  const double cell = board.marker_size / board.square_size / bits;
  const double around = 0.5 * (1 - board.marker_size / board.square_size);
  const auto widths = [&](int squares) {
    std::vector<double> out{kEdge};
    for (int square = 0; square < squares; ++square) {
      out.push_back(around);
      out.insert(out.end(), static_cast<std::size_t>(bits), cell);
      out.push_back(around);
    }
    out.push_back(kEdge);
    return out;
  };
  CardPrint print{cv::Mat(board.rows * cells + 2, board.columns * cells + 2, CV_8UC1, 255.0),
                  widths(board.columns), widths(board.rows), board.square_size};
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      const cv::Rect square(1 + column * cells, 1 + row * cells, cells, cells);
      if (board.isWhite(column, row)) {
        const cv::Rect inside(square.x + 1, square.y + 1, bits, bits);
        vision::markerCells(board.dictionary, board.markerIn(column, row))
            .copyTo(print.cells(inside));
      } else {
        print.cells(square) = 0.0;
      }
    }
  }
  return print;
}

/// A number in [lower, upper) from a generator. It is the same on every machine, which the
/// distributions of the standard library do not guarantee.
template <class Generator>
double uniform(Generator& generator, double lower, double upper) {
  const double span = static_cast<double>(Generator::max() - Generator::min()) + 1.0;
  return lower + (upper - lower) * (static_cast<double>(generator() - Generator::min()) / span);
}

/// Fills a polygon, its corners in pixels, with smooth edges.
void fillPolygon(cv::Mat& picture, const cv::Point2d* corners, int count, double gray);

/// The background (CV_8UC1): soft light and `clutter` objects with edges like those of tags and
/// arms, without tags.
cv::Mat paintBackdrop(int width, int height, int clutter, std::uint32_t seed);

namespace {

constexpr int kFractionBits = 4;  // of OpenCV's fixed-point coordinates
constexpr int kMostCorners = 8;

// A frame in the picture for drawing.
struct Place {
  cv::Point2d center;
  cv::Point2d right;  // of unit length

  cv::Point2d at(double x, double y) const {
    return {center.x + x * right.x - y * right.y, center.y + x * right.y + y * right.x};
  }
};

void fillBox(cv::Mat& picture, const Place& place, double x, double y, double half_width,
             double half_height, double gray) {
  const cv::Point2d corners[] = {
      place.at(x - half_width, y - half_height), place.at(x + half_width, y - half_height),
      place.at(x + half_width, y + half_height), place.at(x - half_width, y + half_height)};
  fillPolygon(picture, corners, 4, gray);
}

// Looks like the border of a tag, but its pattern has a four-fold symmetry, so that no family has a
// tag near it.
void paintMockTag(cv::Mat& picture, const Place& place, double half, bool hollow) {
  fillBox(picture, place, 0, 0, 1.3 * half, 1.3 * half, 225);
  fillBox(picture, place, 0, 0, half, half, 35);
  if (hollow) fillBox(picture, place, 0, 0, 0.5 * half, 0.5 * half, 215);
}

void paintCheckerboard(cv::Mat& picture, const Place& place, double half) {
  constexpr int kCells = 5;
  fillBox(picture, place, 0, 0, 1.2 * half, 1.2 * half, 230);
  const double cell = 2 * half / kCells;
  for (int i = 0; i < kCells * kCells; i += 2) {
    fillBox(picture, place, (i % kCells + 0.5) * cell - half, (i / kCells + 0.5) * cell - half,
            0.5 * cell, 0.5 * cell, 40);
  }
}

}  // namespace

void fillPolygon(cv::Mat& picture, const cv::Point2d* corners, int count, double gray) {
  cv::Point fixed[kMostCorners];
  const double scale = 1 << kFractionBits;
  for (int i = 0; i < count; ++i) {
    fixed[i] = {static_cast<int>(std::lround(corners[i].x * scale)),
                static_cast<int>(std::lround(corners[i].y * scale))};
  }
  cv::fillConvexPoly(picture, fixed, count, cv::Scalar(gray), cv::LINE_AA, kFractionBits);
}

cv::Mat paintBackdrop(int width, int height, int clutter, std::uint32_t seed) {
  cv::Mat picture(height, width, CV_8UC1);
  for (int y = 0; y < height; ++y) {
    uchar* row = picture.ptr<uchar>(y);
    for (int x = 0; x < width; ++x) {
      const double across = static_cast<double>(x) / width, down = static_cast<double>(y) / height;
      row[x] = static_cast<uchar>(std::lround(
          168 - 22 * down - 40 * ((across - 0.4) * (across - 0.4) + (down - 0.3) * (down - 0.3))));
    }
  }
  std::mt19937 generator(seed);
  enum Kind { kBox, kMockTag, kLine, kHollowMockTag, kCheckerboard, kKinds };
  for (int i = 0; i < clutter; ++i) {
    Place place;
    place.center.x = uniform(generator, 0, width);
    place.center.y = uniform(generator, 0, height);
    const double angle = uniform(generator, 0, 2 * CV_PI);
    place.right = {std::cos(angle), std::sin(angle)};
    const double size = uniform(generator, 0.02, 0.06) * width;
    const double stretch = uniform(generator, 0.5, 2.0);
    const double gray = uniform(generator, 60, 210);
    switch (i % kKinds) {
      case kBox:
        fillBox(picture, place, 0, 0, size, size * stretch, gray);
        break;
      case kMockTag:
      case kHollowMockTag:
        paintMockTag(picture, place, 0.4 * size, i % kKinds == kHollowMockTag);
        break;
      case kLine:
        fillBox(picture, place, 0, 0, 5 * size, 0.03 * size * stretch, gray);
        break;
      default:
        paintCheckerboard(picture, place, 0.7 * size);
        break;
    }
  }
  return picture;
}

namespace {

constexpr double kWander = 0.4;  // of a bar from the middle, relative to the picture

}  // namespace

/// Bars that move through the picture, in front of everything else.
class Occluders {
 public:
  /// @param count  of bars, >= 0.
  Occluders(int count, std::mt19937& generator) : bars_(count) {
    const auto rate = [&generator] {
      const double speed = uniform(generator, 0.015, 0.05);
      return uniform(generator, -1, 1) < 0 ? -speed : speed;
    };
    const auto phase = [&generator] { return uniform(generator, 0, 2 * CV_PI); };
    for (Bar& bar : bars_) {
      bar.x_rate = rate();
      bar.x_phase = phase();
      bar.y_rate = rate();
      bar.y_phase = phase();
      bar.turn_rate = rate();
      bar.turn_phase = phase();
      bar.half_width = uniform(generator, 0.02, 0.04);
      bar.half_length = uniform(generator, 0.2, 0.4);
      bar.gray = uniform(generator, 50, 120);
    }
  }

  /// Draws the bars at their positions in picture number picture_number.
  void draw(int picture_number, cv::Mat& picture) const {
    const double width = picture.cols, height = picture.rows;
    for (const Bar& bar : bars_) {
      const double t = picture_number;
      const cv::Point2d center(width * (0.5 + kWander * std::sin(bar.x_rate * t + bar.x_phase)),
                               height * (0.5 + kWander * std::sin(bar.y_rate * t + bar.y_phase)));
      const double angle = bar.turn_rate * t + bar.turn_phase;
      const cv::Point2d right(std::cos(angle), std::sin(angle)), down(-right.y, right.x);
      const cv::Point2d a = bar.half_length * height * right, b = bar.half_width * height * down;
      const cv::Point2d corners[] = {center - a - b, center + a - b, center + a + b,
                                     center - a + b};
      fillPolygon(picture, corners, 4, bar.gray);
    }
  }

 private:
  // In fractions of the picture and radians per picture.
  struct Bar {
    double x_rate, x_phase, y_rate, y_phase, turn_rate, turn_phase, half_width, half_length, gray;
  };

  std::vector<Bar> bars_;
};

namespace {

using estimation::ArmView;

constexpr double kLeastCosine = 0.02;  // of the angle of a face that is still drawn

// The arm is drawn as bands from rim to middle, with light from the left.
struct Band {
  double left, right;  // relative to half the width
  double gray;
};
constexpr std::array<Band, 5> kBands = {
    {{-1.0, 1.0, 62}, {-0.88, 0.82, 84}, {-0.72, 0.55, 104}, {-0.55, 0.2, 122}, {-0.4, -0.1, 136}}};
constexpr double kRingGray = 0.9;  // of every other piece of the arm, which gives it rings
constexpr int kPiecesPerSection = 32;
constexpr double kUsualRadius = 0.03;  // [m]

constexpr int kNoiseTable = 1 << 16;
constexpr double kBlurReach = 3.5;  // standard deviations

struct ArmNode {
  bool seen = false;
  cv::Point2d pixel;
  double per_metre = 0;  // focal length / depth [px/m]
  double depth = 0;      // [m]
};

// An object to draw; the farthest first.
struct Layer {
  double depth;  // [m]
  int tag;       // -1: a piece of the arm
  int piece;
};

}  // namespace

void SimulatedCameraConfig::validate() const {
  const char* const not_negative = "a finite value >= 0";
  basics::requireValue(std::isfinite(blur) && blur >= 0, kSimulatedCamera, "the blur [px]", blur,
                       not_negative);
  basics::requireValue(std::isfinite(noise) && noise >= 0, kSimulatedCamera,
                       "the noise [gray levels]", noise, not_negative);
  basics::requirePositive(kSimulatedCamera, "the exposure", exposure);
  basics::requireValue(std::isfinite(bleed) && bleed >= 0, kSimulatedCamera, "the bleed [m]", bleed,
                       not_negative);
  basics::requireValue(jpeg_quality >= 1 && jpeg_quality <= 100, kSimulatedCamera,
                       "the JPEG quality", jpeg_quality, "1 to 100");
  basics::requireValue(clutter >= 0, kSimulatedCamera, "the number of objects in the background",
                       clutter, "a value >= 0");
  basics::requireValue(occluders >= 0, kSimulatedCamera, "the number of occluders", occluders,
                       "a value >= 0");
}

namespace {

// Returns the view after checking all parts.
const ArmView& checked(const ArmView& view, const ArmBody& body,
                       const SimulatedCameraConfig& config) {
  view.validate();
  config.validate();
  basics::requireValue(
      body.radius.empty() || body.radius.size() == static_cast<std::size_t>(view.sections),
      kSimulatedCamera, "the number of radii", static_cast<double>(body.radius.size()),
      "one per section");
  for (const double radius : body.radius) {
    basics::requirePositive(kSimulatedCamera, "the arm's radius [m]", radius);
  }
  return view;
}

std::vector<CardPrint> printsOf(const estimation::TagLayout& layout,
                                const vision::TagFamily& family) {
  std::vector<CardPrint> prints;
  for (const estimation::TagPlacement& tag : layout.tags) {
    basics::requireValue(tag.id < family.count(), kSimulatedCamera, "the id of a tag", tag.id,
                         "one that the family of the tags has");
    prints.push_back(tagPrint(family, tag.id, layout.size));
  }
  return prints;
}

// Includes 0.5, so that truncation becomes rounding.
std::vector<float> noiseTable(double deviation, std::uint32_t seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  std::vector<float> table(kNoiseTable);
  for (float& value : table) value = static_cast<float>(0.5 + deviation * normal(generator));
  return table;
}

}  // namespace

struct SimulatedCamera::Workspace {
  Workspace(const ArmView& view_in, const std::vector<CardPrint>& prints, const ArmBody& body_in,
            const SimulatedCameraConfig& config_in)
      : view(checked(view_in, body_in, config_in)),
        body(body_in),
        config(config_in),
        tags(view.camera, prints, config.bleed),
        generator(config.seed),
        occluders(config.occluders, generator) {
    const estimation::Camera& camera = view.camera;
    backdrop = paintBackdrop(camera.width, camera.height, config.clutter, config.seed);
    noise = noiseTable(config.noise, config.seed);
    noise.resize(kNoiseTable + camera.width);  // a row may begin anywhere in the table
    for (int x = 0; x < camera.width; ++x) noise[kNoiseTable + x] = noise[x % kNoiseTable];
    picture.create(camera.height, camera.width, CV_8UC1);
  }

  const cv::Mat& render(const model::Shape& shape) {
    basics::requireValue(shape.sectionCount() == view.sections, kSimulatedCamera,
                         "the number of sections", shape.sectionCount(),
                         "one per section of the arm in view");
    basics::requireValue(shape.pieces().allFinite(), kSimulatedCamera, "a twist", "not finite",
                         "finite twists");
    backdrop.copyTo(sharp);
    collectLayers(shape);
    for (const Layer& layer : layers) {
      if (layer.tag < 0) {
        drawPiece(layer.piece);
      } else {
        tags.draw(layer.tag, tag_poses[layer.tag], sharp);
      }
    }
    occluders.draw(picture_number, sharp);
    if (config.blur > 0) {
      const int reach = std::max(1, static_cast<int>(std::ceil(kBlurReach * config.blur)));
      cv::GaussianBlur(sharp, blurred, cv::Size(2 * reach + 1, 2 * reach + 1), config.blur,
                       config.blur, cv::BORDER_REPLICATE);
    }
    develop();
    ++picture_number;
    return picture;
  }

  void collectLayers(const model::Shape& shape) {
    layers.clear();
    tag_poses = estimation::tagPoses(view.layout, shape);
    for (std::size_t i = 0; i < tag_poses.size(); ++i) {
      lie::SE3& X_CT = tag_poses[i];
      X_CT = view.X_CB * X_CT;
      const double depth = X_CT.translation.norm();
      if (-X_CT.rotation.col(2).dot(X_CT.translation) < kLeastCosine * depth) continue;
      layers.push_back({depth, static_cast<int>(i), -1});
    }

    const auto curve = model::sampleToTip(shape, kPiecesPerSection * view.sections + 1);
    nodes.assign(curve.size(), {});
    for (std::size_t i = 0; i < curve.size(); ++i) {
      const Eigen::Vector3d p_C = view.X_CB * curve[i].X.translation;
      const auto pixel = view.camera.project(p_C);
      nodes[i].depth = p_C.norm();
      if (!pixel || !(pixel->cwiseAbs().maxCoeff() < kFarOff)) continue;
      nodes[i].seen = true;
      nodes[i].pixel = {pixel->x(), pixel->y()};
      nodes[i].per_metre = view.camera.fx / p_C.z();
    }
    for (int i = 0; i + 1 < static_cast<int>(nodes.size()); ++i) {
      if (!nodes[i].seen || !nodes[i + 1].seen) continue;
      // Its depth is that of its far side, so that tags on its near side and beside it are drawn
      // later.
      layers.push_back({0.5 * (nodes[i].depth + nodes[i + 1].depth) + radiusOf(i), -1, i});
    }
    std::sort(layers.begin(), layers.end(),
              [](const Layer& a, const Layer& b) { return a.depth > b.depth; });
  }

  void drawPiece(int piece) {
    const ArmNode& from = nodes[piece];
    const ArmNode& to = nodes[piece + 1];
    // Direction across the arm at each end, from the neighbours, so that pieces join without gaps.
    const double radius = radiusOf(piece);
    const auto across = [this, radius](int i) {
      const int last = static_cast<int>(nodes.size()) - 1;
      const ArmNode& before = nodes[std::max(0, i - 1)].seen ? nodes[std::max(0, i - 1)] : nodes[i];
      const ArmNode& after =
          nodes[std::min(last, i + 1)].seen ? nodes[std::min(last, i + 1)] : nodes[i];
      const cv::Point2d along = after.pixel - before.pixel;
      const double length = std::hypot(along.x, along.y);
      const double scale = length > 0 ? radius * nodes[i].per_metre / length : 0.0;
      return cv::Point2d(-along.y * scale, along.x * scale);
    };
    const cv::Point2d across_from = across(piece), across_to = across(piece + 1);
    const double tone = piece % 2 == 0 ? 1.0 : kRingGray;
    for (const Band& band : kBands) {
      const cv::Point2d corners[] = {
          from.pixel + band.left * across_from, from.pixel + band.right * across_from,
          to.pixel + band.right * across_to, to.pixel + band.left * across_to};
      fillPolygon(sharp, corners, 4, tone * band.gray);
    }
  }

  double radiusOf(int piece) const {
    if (body.radius.empty()) return kUsualRadius;
    return body.radius[std::min(piece / kPiecesPerSection, view.sections - 1)];
  }

  void develop() {
    const cv::Mat& light = config.blur > 0 ? blurred : sharp;
    const auto gain = static_cast<float>(config.exposure);
    for (int y = 0; y < light.rows; ++y) {
      const uchar* from = light.ptr<uchar>(y);
      const float* add = noise.data() + generator() % kNoiseTable;
      uchar* to = picture.ptr<uchar>(y);
      for (int x = 0; x < light.cols; ++x) {
        const float value = gain * static_cast<float>(from[x]) + add[x];
        to[x] = static_cast<uchar>(static_cast<int>(std::min(255.0F, std::max(0.0F, value))));
      }
    }
  }

  ArmView view;
  ArmBody body;
  SimulatedCameraConfig config;
  TagPainter tags;
  cv::Mat backdrop, sharp, blurred, picture;
  std::vector<float> noise;  // added by develop() before truncation
  std::mt19937 generator;
  Occluders occluders;
  int picture_number = 0;

  // State of the picture that is being rendered.
  std::vector<lie::SE3> tag_poses;  // X_CT
  std::vector<ArmNode> nodes;
  std::vector<Layer> layers;
};

SimulatedCamera::SimulatedCamera(const ArmView& view, const vision::TagFamily& family,
                                 const ArmBody& body, const SimulatedCameraConfig& config)
    : SimulatedCamera(view, printsOf(checked(view, body, config).layout, family), body, config) {}
SimulatedCamera::SimulatedCamera(const ArmView& view, const std::vector<CardPrint>& prints,
                                 const ArmBody& body, const SimulatedCameraConfig& config)
    : work_(std::make_unique<Workspace>(view, prints, body, config)) {}
SimulatedCamera::~SimulatedCamera() = default;
SimulatedCamera::SimulatedCamera(SimulatedCamera&&) noexcept = default;
SimulatedCamera& SimulatedCamera::operator=(SimulatedCamera&&) noexcept = default;

const cv::Mat& SimulatedCamera::render(const model::Shape& shape) { return work_->render(shape); }

}  // namespace helix_arm::simulation
