#pragma once

#include <QElapsedTimer>
#include <QWidget>

#include "ros_bridge/cockpit/cockpit_view.hpp"
#include "ros_bridge/cockpit/strip_history.hpp"

namespace helix_arm::rviz_panel {

/// Pressures (upper half, kPa) and tip error (lower half, mm) over the last seconds.
class StripChart : public QWidget {
 public:
  explicit StripChart(QWidget* parent);

  /// Adds the present moment.
  void add(const ros_bridge::CockpitView& view);
  void clear();

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  void drawPressures(QPainter& painter, const QRectF& area) const;
  void drawError(QPainter& painter, const QRectF& area) const;

  QElapsedTimer clock_;
  ros_bridge::StripHistory history_;
  bool from_target_ = false;  ///< the error is that of the closed loop, not that of the model
};

}  // namespace helix_arm::rviz_panel
