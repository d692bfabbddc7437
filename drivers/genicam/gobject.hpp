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

// Silences GLib's log on standard error from now on: for a damaged description it prints dozens of lines at each try,
// where the call's error is one. Thread: any.
inline void silence_glib() noexcept {
  g_log_set_default_handler([](const char*, GLogLevelFlags, const char*, void*) {}, nullptr);
}

// One reference to a GObject, given up at the end of scope.
template <typename T>
using Ref = std::unique_ptr<T, Unref>;

// Memory that GLib allocated.
template <typename T>
using Owned = std::unique_ptr<T, Free>;

// Holds the error of a call of GLib: pass out() to one call, then test.
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
  // The camera did not answer at all, as opposed to answering no.
  bool unanswered() const noexcept {
    return error_ != nullptr && error_->domain == ARV_DEVICE_ERROR &&
           (error_->code == ARV_DEVICE_ERROR_TIMEOUT || error_->code == ARV_DEVICE_ERROR_NOT_CONNECTED ||
            error_->code == ARV_DEVICE_ERROR_TRANSFER_ERROR);
  }

 private:
  GError* error_ = nullptr;
};

}  // namespace bolo::genicam
