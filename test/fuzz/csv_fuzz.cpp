// Any bytes as a data set: a table of finite numbers or a DocumentError, through every reader of
// tables; and corners and paths that were read are the same when they are written and read again.
#include <optional>

#include "helix_arm/io/data_set.hpp"
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/tag_table.hpp"
#include "io/data/tip_path_file.hpp"
#include "memory_file.hpp"
#include "procedures/captures.hpp"
#include "procedures/response_series.hpp"

namespace {

using namespace helix_arm;
using test::demand;
using test::MemoryFile;

constexpr int kActuators = 3;

// What a reader gives, nothing where it refuses.
template <class Reader>
auto read(Reader reader) -> std::optional<decltype(reader())> {
  try {
    return reader();
  } catch (const io::DocumentError& error) {
    demand(*error.what() != '\0');
    return std::nullopt;
  }
}

void roundTrip(const MemoryFile& file, const std::vector<io::TagCornerCapture>& captures) {
  const std::string text = io::tagCornerCsv(captures, kActuators, "");
  file.write(text.data(), text.size());
  const auto again = io::loadTagCorners(io::loadDataSet(file.path()), kActuators);
  demand(again.size() == captures.size());
  for (std::size_t i = 0; i < again.size(); ++i) {
    demand(again[i].number == captures[i].number);
    demand(again[i].tags.size() == captures[i].tags.size());
    for (std::size_t k = 0; k < again[i].tags.size(); ++k) {
      demand(again[i].tags[k].id == captures[i].tags[k].id);
      demand(again[i].tags[k].corners == captures[i].tags[k].corners);
    }
  }
}

// A path that was read is one for control::TipPath, too.
void roundTrip(const MemoryFile& file, const std::vector<control::TipWayPoint>& points) {
  const control::TipPath path(points);
  demand(path.at(path.lastTime()).position.allFinite());
  const std::string text = io::tipPathCsv(points, "");
  file.write(text.data(), text.size());
  const auto again = io::loadTipPath(io::loadDataSet(file.path()));
  demand(again.size() == points.size());
  for (std::size_t i = 0; i < again.size(); ++i) {
    demand(again[i].time == points[i].time && again[i].position == points[i].position);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  static const MemoryFile file;
  static const io::Scene scene = io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/demo.yaml");
  file.write(bytes, size);
  const auto data = read([] { return io::loadDataSet(file.path()); });
  if (!data) return 0;
  demand(data->values.rows() > 0 && data->values.allFinite());
  demand(data->values.rows() == static_cast<Eigen::Index>(data->lines.size()));
  demand(data->values.cols() == static_cast<Eigen::Index>(data->columns.size()));

  read([&] { return procedures::kindOf(*data); });
  read([&] { return io::pressuresOf(*data, kActuators); });
  read([&] { return procedures::lengthSeriesOf(*data); });
  read([&] { return procedures::tipSeriesOf(*data, kActuators); });
  read([&] { return procedures::loadCaptures(scene, *data); });
  read([&] { return io::loadTagPoses(*data, kActuators, lie::SE3()); });
  const auto corners = read([&] { return io::loadTagCorners(*data, kActuators); });
  if (corners) roundTrip(file, *corners);
  const auto points = read([&] { return io::loadTipPath(*data); });
  if (points) roundTrip(file, *points);
  return 0;
}
