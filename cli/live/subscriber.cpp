#include "cli/live/subscriber.h"

namespace servotwin::cli {

bool Subscriber::receive(LiveRecord& record) {
  double wait_s = 0.02;
  bool any = false;
  while (predictions_.receive(prediction_, wait_s)) {
    take_frames(record);
    record.on_prediction(prediction_, predictions_.written_ns());
    on_prediction(prediction_);
    predicts_ = predictions_.writer();
    any = true;
    wait_s = 0.0;
  }
  take_frames(record);
  while (statuses_.receive(status_, 0.0)) {
    record.on_status(status_);
    on_status(status_);
    daemon_ = statuses_.writer();
  }
  while (models_.receive(model_, 0.0)) {
    record.on_model(model_);
    on_model(model_);
  }
  while (diagnoses_.receive(diagnosis_, 0.0)) {
    record.on_diagnosis(diagnosis_);
    on_diagnosis(diagnosis_);
  }
  return any;
}

void Subscriber::take_frames(LiveRecord& record) {
  while (frames_.receive(frame_, 0.0)) {
    record.on_frame(frame_, frames_.written_ns());
    machine_ = frames_.writer();
  }
}

}  // namespace servotwin::cli
