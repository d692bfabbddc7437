// The camera's GenICam description, made from one table: what a FLIR A655sc offers, in its words, and the registers
// (camera_features.hpp) that hold it.
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "drivers/fakecam/camera_features.hpp"

namespace bolo::fakecam {
namespace {

// Kinds of features, as their nodes are named.
using Kind = std::string_view;
constexpr Kind kInteger = "Integer";
constexpr Kind kFloat = "Float";
constexpr Kind kEnumeration = "Enumeration";
constexpr Kind kBoolean = "Boolean";
constexpr Kind kCommand = "Command";
constexpr Kind kText = "StringReg";

struct Register {
  std::uint32_t address;
  std::string_view access = "RO";
  int bytes = 4;
  std::string_view bits{};  // that the value is in; empty: all of them
  std::string_view sign = "Unsigned";
};

struct Feature {
  Kind kind;
  std::string_view name;
  std::string_view tip;
  Register at;
  std::string content;  // of its node: limits, unit, entries
  std::string_view visibility;
};
Feature feature(Kind kind, std::string_view name, std::string_view tip, const Register& at, std::string content = {},
                std::string_view visibility = "Beginner") {
  return {kind, name, tip, at, std::move(content), visibility};
}

struct Category {
  std::string_view name;
  std::vector<Feature> features;
};

std::string range(double min, double max) { return fmt::format("<Min>{:.10g}</Min><Max>{:.10g}</Max>", min, max); }

std::string in(std::string_view unit) { return fmt::format("<Unit>{}</Unit>", unit); }

std::string entry(std::string_view name, std::uint32_t number) {
  return fmt::format(R"(<EnumEntry Name="{}"><Value>{}</Value></EnumEntry>)", name, number);
}

// With the numbers from 0 on.
std::string entries(std::initializer_list<std::string_view> names) {
  std::string text;
  for (std::uint32_t number = 0; const auto name : names) text += entry(name, number++);
  return text;
}

std::string value(int of_command) { return fmt::format("<CommandValue>{}</CommandValue>", of_command); }

std::vector<Category> categories() {
  const std::string any = range(0, 0xffffffff);
  constexpr std::string_view kLowHalf = "<LSB>31</LSB><MSB>16</MSB>";  // bit 0 is the highest
  return {
      {"DeviceControl",
       {feature(kText, "DeviceVendorName", "Name of the manufacturer", {reg::kManufacturer, "RO", 32}),
        feature(kText, "DeviceModelName", "Name of the model", {reg::kModel, "RO", 32}),
        feature(kText, "DeviceVersion", "Version of the device", {reg::kDeviceVersion, "RO", 32}),
        feature(kText, "DeviceManufacturerInfo", "More about the device", {reg::kManufacturerInfo, "RO", 48}),
        feature(kText, "DeviceSerialNumber", "Serial number", {reg::kSerial, "RO", 16}),
        feature(kText, "DeviceID", "Serial number, under its older name", {reg::kSerial, "RO", 16}),
        feature(kText, "DeviceUserID", "Name given by the user", {reg::kUserName, "RW", 16}),
        feature(kFloat, "DeviceTemperature", "Temperature of the housing", {reg::kDeviceTemperature}, in("C"))}},
      {"ImageFormatControl",
       {feature(kInteger, "SensorWidth", "Columns of the sensor", {reg::kSensorWidth}, any),
        feature(kInteger, "SensorHeight", "Rows of the sensor", {reg::kSensorHeight}, any),
        feature(kInteger, "WidthMax", "Largest width", {reg::kSensorWidth}, any),
        feature(kInteger, "HeightMax", "Largest height", {reg::kSensorHeight}, any),
        feature(kInteger, "Width", "Columns of the image; centred unless OffsetX was written", {reg::kWidth, "RW"},
                "<Min>1</Min><pMax>WidthMax</pMax><Inc>1</Inc>"),
        feature(kInteger, "Height", "Rows of the image; centred unless OffsetY was written", {reg::kHeight, "RW"},
                "<Min>1</Min><pMax>HeightMax</pMax><Inc>1</Inc>"),
        feature(kInteger, "OffsetX", "First column of the image", {reg::kOffsetX, "RW"},
                "<Min>0</Min><pMax>OffsetXMax</pMax><Inc>1</Inc>"),
        feature(kInteger, "OffsetY", "First row of the image", {reg::kOffsetY, "RW"},
                "<Min>0</Min><pMax>OffsetYMax</pMax><Inc>1</Inc>"),
        feature(kEnumeration, "PixelFormat", "Format of a pixel", {reg::kPixelFormat, "RW"},
                entry("Mono16", gvsp::kMono16))}},
      {"AcquisitionControl",
       {feature(kEnumeration, "AcquisitionMode", "How many frames a start asks for", {reg::kAcquisitionMode, "RW"},
                entries({"Continuous", "SingleFrame"})),
        feature(kCommand, "AcquisitionStart", "Starts the stream", {reg::kAcquisitionStart, "RW"}, value(1)),
        feature(kCommand, "AcquisitionStop", "Stops the stream", {reg::kAcquisitionStop, "RW"}, value(1)),
        feature(kFloat, "AcquisitionFrameRate", "Frames a second; taken over at the next start",
                {reg::kFrameRate, "RW"}, range(0.01, 10000) + in("Hz")),
        feature(kEnumeration, "TriggerSelector", "Which trigger the next feature is about",
                {reg::kTriggerSelector, "RW"}, entries({"FrameStart"})),
        feature(kEnumeration, "TriggerMode", "The camera runs freely", {reg::kTriggerMode, "RW"}, entries({"Off"}))}},
      {"InfraredControl",
       {feature(kEnumeration, "IRFormat", "What a count means", {reg::kIrFormat, "RW"},
                entries({"Radiometric", "TemperatureLinear100mK", "TemperatureLinear10mK"})),
        feature(kEnumeration, "IRWindowing", "Rows that are read: all, the middle half, the middle quarter",
                {reg::kIrWindowing, "RW"}, entries({"Off", "Half", "Quarter"})),
        feature(kEnumeration, "IRFrameRate",
                "Frame rate of the whole sensor; kept only, the replayed capture sets the pace",
                {reg::kIrFrameRate, "RW"}, entries({"Rate50Hz", "Rate25Hz", "Rate12Hz", "Rate6Hz", "Rate3Hz"})),
        feature(kEnumeration, "NUCMode", "When the camera corrects its non-uniformity", {reg::kNucMode, "RW"},
                entries({"Off", "Automatic"})),
        feature(kCommand, "NUCAction", "Corrects the non-uniformity now", {reg::kNucAction, "RW"}, value(1)),
        feature(kInteger, "NUCCount", "How often NUCAction was executed", {reg::kNucCount}, any),
        feature(kCommand, "AutoFocus", "Focuses", {reg::kAutoFocus, "RW"}, value(1)),
        feature(kInteger, "FocusPos", "Position of the focus", {reg::kFocusPosition, "RW"}, range(0, 65535))}},
      {"ObjectParameters",
       {feature(kFloat, "ReflectedTemperature", "Temperature that the object reflects",
                {reg::kReflectedTemperature, "RW"}, range(0, 5000) + in("K")),
        feature(kFloat, "AtmosphericTemperature", "Temperature of the air", {reg::kAtmosphericTemperature, "RW"},
                range(0, 5000) + in("K")),
        feature(kFloat, "ObjectDistance", "Distance of the object", {reg::kObjectDistance, "RW"},
                range(0, 10000) + in("m")),
        feature(kFloat, "ObjectEmissivity", "Emissivity of the object", {reg::kObjectEmissivity, "RW"},
                range(0.001, 1)),
        feature(kFloat, "RelativeHumidity", "Humidity of the air", {reg::kRelativeHumidity, "RW"}, range(0, 1)),
        feature(kFloat, "ExtOpticsTemperature", "Temperature of a window before the lens",
                {reg::kExtOpticsTemperature, "RW"}, range(0, 5000) + in("K")),
        feature(kFloat, "ExtOpticsTransmission", "Transmission of a window before the lens",
                {reg::kExtOpticsTransmission, "RW"}, range(0.001, 1)),
        feature(kFloat, "EstimatedTransmission", "Transmission of the air", {reg::kEstimatedTransmission, "RW"},
                range(0, 1))}},
      {"MeasurementRanges",
       {feature(kInteger, "NumCases", "Number of ranges", {reg::kNumCases}, any),
        feature(kInteger, "QueryCase", "Range that the limits are about", {reg::kQueryCase, "RW"}, range(0, 2)),
        feature(kFloat, "QueryCaseLowLimit", "Its lowest temperature", {reg::kQueryCaseLowLimit}, in("K")),
        feature(kFloat, "QueryCaseHighLimit", "Its highest temperature", {reg::kQueryCaseHighLimit}, in("K")),
        feature(kInteger, "CurrentCase", "Range in use", {reg::kCurrentCase, "RW"}, range(0, 2))}},
      {"PlanckConstants",
       {feature(kInteger, "R", "Planck constant R", {reg::kPlanckR}, any),
        feature(kInteger, "J0", "Offset of the radiance counts", {reg::kPlanckJ0}, any),
        feature(kFloat, "B", "Planck constant B, K", {reg::kPlanckB}),
        feature(kFloat, "F", "Planck constant F", {reg::kPlanckF}),
        feature(kFloat, "J1", "Gain of the radiance counts", {reg::kPlanckJ1}),
        feature(kFloat, "X", "Attenuation of the air: X", {reg::kAtmosphereX}),
        feature(kFloat, "alpha1", "Attenuation of the air: alpha1", {reg::kAlpha1}),
        feature(kFloat, "alpha2", "Attenuation of the air: alpha2", {reg::kAlpha2}),
        feature(kFloat, "beta1", "Attenuation of the air: beta1", {reg::kBeta1}),
        feature(kFloat, "beta2", "Attenuation of the air: beta2", {reg::kBeta2})}},
      {"TransportLayerControl",
       {feature(kInteger, "PayloadSize", "Bytes of an image", {reg::kPayloadSize}, any),
        feature(kInteger, "TLParamsLocked", "Whether the client has locked the image format",
                {reg::kParametersLocked, "RW"}, range(0, 1), "Invisible"),
        feature(kInteger, "GevHeartbeatTimeout", "Silence after which the camera leaves its client",
                {reg::kHeartbeatTimeout, "RW"}, range(500, 0xffffffff) + in("ms"), "Guru"),
        feature(kInteger, "GevTimestampTickFrequency", "Ticks of a second of the time stamps",
                {reg::kTickFrequencyLow - 4, "RO", 8}, in("Hz"), "Expert"),
        feature(kCommand, "GevTimestampControlLatch", "Latches the clock into GevTimestampValue",
                {reg::kTimestampControl, "WO"}, value(reg::kTimestampLatch), "Expert"),
        feature(kCommand, "GevTimestampControlReset", "Sets the clock to 0", {reg::kTimestampControl, "WO"},
                value(reg::kTimestampReset), "Expert"),
        feature(kCommand, "GevTimestampControlLatchReset", "Latches the clock and sets it to 0",
                {reg::kTimestampControl, "WO"}, value(reg::kTimestampLatch | reg::kTimestampReset), "Expert"),
        feature(kInteger, "GevTimestampValue", "The clock when it was latched", {reg::kTimestampHigh, "RO", 8},
                in("ns"), "Expert"),
        feature(kBoolean, "PtpEnable", "The clock follows a PTP master (IEEE 1588)", {reg::kPtpEnable, "RW"}, {},
                "Expert"),
        feature(kCommand, "PtpDataSetLatch", "Latches PtpStatus and PtpOffsetFromMaster", {reg::kPtpLatch, "WO"},
                value(1), "Expert"),
        feature(kEnumeration, "PtpStatus", "State of the clock when it was latched", {reg::kPtpStatus},
                entries({"Initializing", "Faulty", "Disabled", "Listening", "PreMaster", "Master", "Passive",
                         "Uncalibrated", "Slave"}),
                "Expert"),
        feature(kInteger, "PtpOffsetFromMaster", "How far the clock was from its master's when it was latched",
                {reg::kPtpOffset, "RO", 4, {}, "Signed"}, in("ns"), "Expert"),
        feature(kEnumeration, "GevCCP", "Who may write", {reg::kPrivilege, "RW"},
                entries({"OpenAccess", "ExclusiveAccess", "ControlAccess"}), "Guru"),
        feature(kInteger, "GevSCPHostPort", "UDP port that the stream goes to; 0 closes it",
                {reg::kStreamPort, "RW", 4, kLowHalf}, range(0, 65535) + "<Inc>1</Inc>", "Expert"),
        feature(kInteger, "GevSCPSPacketSize", "Bytes of a packet with its IP and UDP headers",
                {reg::kStreamPacketSize, "RW", 4, kLowHalf},
                range(gvsp::kMinPacketSize, gvsp::kMaxPacketSize) + "<Inc>4</Inc>", "Expert"),
        feature(kBoolean, "GevSCPSDoNotFragment", "Refuse packets that the link would split",
                {reg::kStreamPacketSize, "RW", 4, "<Bit>1</Bit>"}, {}, "Guru"),
        feature(kCommand, "GevSCPSFireTestPacket", "Sends one packet of GevSCPSPacketSize",
                {reg::kStreamPacketSize, "RW", 4, "<Bit>0</Bit>"}, value(1), "Guru"),
        feature(kInteger, "GevSCPD", "Ticks between packets", {reg::kStreamPacketDelay, "RW"}, range(0, 1e7), "Expert"),
        feature(kInteger, "GevSCDA", "IPv4 address that the stream goes to", {reg::kStreamAddress, "RW"},
                any + "<Representation>IPV4Address</Representation>", "Guru"),
        feature(kInteger, "GevSCSP", "UDP port that the stream comes from", {reg::kStreamSourcePort}, any, "Guru")}}};
}

std::string place(const Register& at) {
  return fmt::format(
      "<Address>{:#x}</Address><Length>{}</Length><AccessMode>{}</AccessMode><pPort>Device</pPort>"
      "<Cachable>NoCache</Cachable>",
      at.address, at.bytes, at.access);
}

// Its node, and the node of its register; a text is its own register.
std::string nodes(const Feature& described) {
  const auto& [kind, name, tip, at, content, visibility] = described;
  const std::string about = fmt::format("<ToolTip>{}</ToolTip><Visibility>{}</Visibility>", tip, visibility);
  if (kind == kText) return fmt::format("<StringReg Name=\"{}\">{}{}</StringReg>\n", name, about, place(at));
  const std::string from = fmt::format("<pValue>{}Reg</pValue>", name);
  const bool entries_first = kind == kEnumeration;
  std::string text =
      fmt::format("<{0} Name=\"{1}\">{2}{3}{4}{5}</{0}>\n", kind, name, about, entries_first ? content : from,
                  entries_first ? from : content, kind == kBoolean ? "<OnValue>1</OnValue><OffValue>0</OffValue>" : "");
  const std::string_view integer = at.bits.empty() ? "IntReg" : "MaskedIntReg";
  const std::string sign = kind == kFloat ? "" : fmt::format("{}<Sign>{}</Sign>", at.bits, at.sign);
  return text + fmt::format("<{0} Name=\"{1}Reg\">{2}{3}<Endianess>BigEndian</Endianess></{0}>\n",
                            kind == kFloat ? "FloatReg" : integer, name, place(at), sign);
}

std::string category(std::string_view name, const std::string& names) {
  return fmt::format("<Category Name=\"{}\">{}</Category>\n", name, names);
}

std::string feature_name(std::string_view name) { return fmt::format("<pFeature>{}</pFeature>", name); }

std::string make_description() {
  std::string root;
  std::string all;
  for (const Category& c : categories()) {
    root += feature_name(c.name);
    std::string names;
    for (const Feature& f : c.features) names += feature_name(f.name);
    all += category(c.name, names);
    for (const Feature& f : c.features) all += nodes(f);
  }
  for (const auto& [axis, size] : {std::pair("X", "Width"), std::pair("Y", "Height")}) {
    all += fmt::format(
        "<IntSwissKnife Name=\"Offset{0}Max\"><pVariable Name=\"SENSOR\">Sensor{1}</pVariable>"
        "<pVariable Name=\"SIZE\">{1}</pVariable><Formula>SENSOR - SIZE</Formula></IntSwissKnife>\n",
        axis, size);
  }
  return R"(<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="A655sc_Bolo_fake" VendorName="FLIR_Systems"
 ToolTip="Replays captures as a FLIR A655sc would send them" StandardNameSpace="GEV" SchemaMajorVersion="1"
 SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ProductGuid="6d1b0c6e-6b3f-4a57-9f1c-0f6a55c5cfa1" VersionGuid="0c6b8b42-55d1-4f0e-8a54-2b7a655cb010"
 xmlns="http://www.genicam.org/GenApi/Version_1_1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_1
 http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd">
)" + category("Root", root) +
         all + "<Port Name=\"Device\"></Port>\n</RegisterDescription>\n";
}

}  // namespace

std::string_view description() {
  static const std::string text = make_description();
  return text;
}

}  // namespace bolo::fakecam
