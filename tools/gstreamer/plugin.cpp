// libgstbolo.so: frames of bolod, and deblurring, for pipelines of GStreamer.
#include "tools/gstreamer/elements.hpp"

#define PACKAGE "bolo"  // GST_PLUGIN_DEFINE asks for it

namespace {

gboolean plugin_init(GstPlugin* plugin) {
  return bolo::tools::register_source(plugin) && bolo::tools::register_deblur(plugin) ? TRUE : FALSE;
}

}  // namespace

GST_PLUGIN_DEFINE(GST_VERSION_MAJOR, GST_VERSION_MINOR, bolo, "Sharp frames of moving thermal cameras", plugin_init,
                  BOLO_VERSION, GST_LICENSE_UNKNOWN, "bolo", "https://bolo.invalid")
