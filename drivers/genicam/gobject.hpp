// Ownership of GLib's objects and errors.
#pragma once

#include <arv.h>

#include <memory>
#include <string>

namespace bolo::genicam {

struct Unref {
  void operator()(void* object) const noexcept { g_object_unref(object); }
};
struct Free {
  void operator()(void* memory) const noexcept { g_free(memory); }
};

// Silences GLib's log on standard error: dozens of lines per damaged description, besides the error. What ends the
// program is shown. Thread: any.
inline void silence_glib() noexcept {
  const auto handler = [](const char* domain, GLogLevelFlags level, const char* message, void* data) {
    if ((level & G_LOG_FLAG_FATAL) != 0) g_log_default_handler(domain, level, message, data);
  };
  g_log_set_default_handler(handler, nullptr);
}

template <typename T>
using Ref = std::unique_ptr<T, Unref>;

template <typename T>
using Owned = std::unique_ptr<T, Free>;

// Error of a GLib call: pass out() to one call, then test.
class GlibError {
 public:
  GlibError() = default;
  ~GlibError() { g_clear_error(&error_); }
  GlibError(const GlibError&) = delete;
  GlibError& operator=(const GlibError&) = delete;

  GError** out() noexcept {
    g_clear_error(&error_);
    return &error_;
  }
  explicit operator bool() const noexcept { return error_ != nullptr; }
  std::string message() const { return error_ != nullptr ? error_->message : "no reason given"; }
  // True when the camera did not answer, rather than refuse.
  bool unanswered() const noexcept {
    return error_ != nullptr && error_->domain == ARV_DEVICE_ERROR &&
           (error_->code == ARV_DEVICE_ERROR_TIMEOUT || error_->code == ARV_DEVICE_ERROR_NOT_CONNECTED ||
            error_->code == ARV_DEVICE_ERROR_TRANSFER_ERROR);
  }

 private:
  GError* error_ = nullptr;
};

}  // namespace bolo::genicam
