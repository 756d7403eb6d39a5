-- servo-sniffer for Wireshark: requests and answers on robot-servo buses, with their registers.
-- Written by `sniffer wireshark install`.
--
-- The engine is written by hand (sniffer/wireshark/engine); the tables in it are generated from the
-- grammars, commands and register tables that the decoder reads (make wireshark).
-- It reads what `sniffer` writes as pcapng: link type RTAC serial, a packet a frame or a gap, told
-- by the footer of its head; any other RTAC capture is left to Wireshark's own dissector.
--
-- Three things shape it. Wireshark goes over a capture twice, first in order and often without a
-- tree: then frames are paired and what servos told of themselves is kept, by frame number; no
-- field of another dissector is asked, for those are empty then. Whatever is shown is made only if
-- there is a tree. And it must run in Lua 5.1 (Wireshark 3) up to 5.4: no integer operators.

local P = Proto("servo", "Robot servo bus")

-- Generated up to the next ruler: make wireshark.

local NO_TIMES = ", no times"

local WITHIN = ", stamps within "

local NAMES = {
  acceleration = 0,
  acceleration_ratio = 0,
  ad_input = 0,
  alarm_led = 0,
  alarm_shutdown = 0,
  analog_distance = 0,
  analog_input = 0,
  angular_acceleration = 0,
  angular_acceleration_alpha = 0,
  angular_acceleration_beta = 0,
  angular_acceleration_gamma = 0,
  angular_deceleration = 0,
  angular_holding_stiffness = 0,
  angular_range = 0,
  angular_stiffness = 0,
  baud_rate = 0,
  calibration_long_stroke = 0,
  calibration_short_stroke = 0,
  can_terminal = 0,
  ccw_angle_limit = 0,
  ccw_compliance_margin = 0,
  ccw_compliance_slope = 0,
  center_difference = 0,
  chd = 0,
  cln = 0,
  configured_angular_acceleration = 0,
  configured_angular_deceleration = 0,
  configured_angular_holding_stiffness = 0,
  configured_angular_range = 0,
  configured_angular_stiffness = 0,
  configured_filter_position_count = 0,
  configured_gyre_direction = 0,
  configured_led_color = 0,
  configured_max_speed = 0,
  configured_max_speed_in_rpm = 0,
  configured_motion_control = 0,
  configured_origin_offset = 0,
  configured_step_mode = 0,
  confirm = 0,
  cr = 0,
  csl = 0,
  current_hold = 0,
  current_i_gain = 0,
  current_limit = 0,
  current_limp = 0,
  current_p_gain = 0,
  current_speed = 0,
  cw_angle_limit = 0,
  cw_compliance_margin = 0,
  cw_compliance_slope = 0,
  d_gain = 0,
  damper = 0,
  deceleration_ratio = 0,
  digital_output = 0,
  driver_temperature_error = 0,
  driver_temperature_warning = 0,
  end_compliance_margin = 0,
  error_flags = 0,
  feedback_return_mode = 0,
  filter_position_count = 0,
  firmware_release = 0,
  firmware_update = 0,
  firmware_version = 0,
  first_position = 0,
  first_position_pulse = 0,
  force_limit = 0,
  force_on = 0,
  goal_current = 0,
  goal_position = 0,
  goal_position_10bit = 0,
  goal_position_pulse = 0,
  goal_speed = 0,
  goal_time = 0,
  gyre_direction = 0,
  halt_and_hold = 0,
  hd = 0,
  highest_limit_temperature = 0,
  highest_limit_voltage = 0,
  i_gain = 0,
  ipe = 0,
  is = 0,
  jaw_opening = 0,
  jaw_opening_deg = 0,
  jaw_opening_offset = 0,
  le = 0,
  led = 0,
  led_blinking = 0,
  led_color = 0,
  limp = 0,
  linear_acceleration_x = 0,
  linear_acceleration_y = 0,
  linear_acceleration_z = 0,
  ln = 0,
  load = 0,
  lock = 0,
  long_stroke_compliance_margin = 0,
  long_stroke_limit = 0,
  long_stroke_pulse_width = 0,
  lower_boundary = 0,
  lowest_limit_voltage = 0,
  lp = 0,
  m = 0,
  max_force = 0,
  max_position_calibration = 0,
  max_speed = 0,
  max_speed_in_rpm = 0,
  max_torque = 0,
  maximum_motor_duty = 0,
  mcu_temperature = 0,
  middle_stroke_pulse_width = 0,
  min_position_calibration = 0,
  mm = 0,
  model_number = 0,
  model_string = 0,
  motion_control = 0,
  motion_count = 0,
  motor_operating_rate = 0,
  motor_temperature = 0,
  move_speed = 0,
  move_speed_pulse = 0,
  move_time = 0,
  moving = 0,
  moving_speed = 0,
  origin_offset = 0,
  overload = 0,
  p_gain = 0,
  pid_coefficient = 0,
  po = 0,
  position = 0,
  position_10bit = 0,
  present_current = 0,
  present_load = 0,
  present_motor_operating_rate = 0,
  present_position = 0,
  present_position_mv = 0,
  present_position_pulse = 0,
  present_speed = 0,
  present_speed_in_rpm = 0,
  present_speed_pulse = 0,
  present_status = 0,
  present_temperature = 0,
  present_time = 0,
  present_voltage = 0,
  protocol_type = 0,
  punch = 0,
  punch_initial_value = 0,
  qvt = 0,
  rc_mode = 0,
  rdm = 0,
  received_data = 0,
  relative_move = 0,
  reset = 0,
  resolution_factor = 0,
  restore_defaults = 0,
  return_delay = 0,
  return_delay_time = 0,
  reverse = 0,
  ris = 0,
  rotation_count = 0,
  runtime_acceleration = 0,
  runtime_d_gain = 0,
  runtime_i_gain = 0,
  runtime_p_gain = 0,
  runtime_speed = 0,
  safe_mode_cause = 0,
  serial_number = 0,
  servo_id = 0,
  short_stroke_compliance_margin = 0,
  short_stroke_limit = 0,
  short_stroke_pulse_width = 0,
  speed = 0,
  speed_d_gain = 0,
  speed_i_gain = 0,
  speed_limit = 0,
  speed_p_gain = 0,
  start_compliance_margin = 0,
  step_mode = 0,
  target_position = 0,
  target_speed = 0,
  target_speed_in_rpm = 0,
  temperature_limit = 0,
  third_party_firmware_version = 0,
  third_party_program_interface = 0,
  torque_10bit = 0,
  torque_enable = 0,
  torque_in_silence = 0,
  torque_level = 0,
  tq = 0,
  tqm = 0,
  tqt = 0,
  upper_boundary = 0,
  usb_connection = 0,
  warm_up_time = 0,
  wheel_direction = 0,
  wheel_speed = 0,
  wheel_speed_in_rpm = 0,
  y = 0,
}

local PROTOCOLS = {
  [1] = {
    name = "mightyzap",
    title = "IRROBOT mightyZAP (IR protocol)",
    baud = 57600,
    reach = 260,
    tail = 0.1,
    everyone = {[0] = true, [254] = true},
    watches = {"resolution_factor"},
    models = {
      {
        name = "mightyzap-l12",
        registers = {
          {name = "model_number", address = 0, type = "u16le", width = 2, scale = 1.0},
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 3,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "baud_rate",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [2] = "400000",
              [4] = "250000",
              [8] = "200000",
              [16] = "115200",
              [32] = "57600",
              [64] = "19200",
              [128] = "9600",
            },
            effect = "baud",
          },
          {
            name = "return_delay_time",
            address = 5,
            type = "u8",
            width = 1,
            unit = "us",
            scale = 1.0,
          },
          {
            name = "short_stroke_limit",
            address = 6,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
          },
          {
            name = "long_stroke_limit",
            address = 8,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
          },
          {
            name = "highest_limit_temperature",
            address = 11,
            type = "u8",
            width = 1,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "lowest_limit_voltage",
            address = 12,
            type = "u8",
            width = 1,
            unit = "V",
            scale = 0.1,
          },
          {
            name = "highest_limit_voltage",
            address = 13,
            type = "u8",
            width = 1,
            unit = "V",
            scale = 0.1,
          },
          {name = "max_force", address = 14, type = "u16le", width = 2, scale = 1.0},
          {
            name = "feedback_return_mode",
            address = 16,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "none_except_echo", [1] = "load_data", [2] = "all"},
            effect = "feedback",
          },
          {
            name = "alarm_led",
            address = 17,
            type = "u8",
            width = 1,
            scale = 1.0,
            bits = {
              [0] = "input_voltage",
              [1] = "stroke_limit",
              [2] = "overheating",
              [3] = "range",
              [4] = "checksum",
              [5] = "overload",
              [6] = "instruction",
            },
          },
          {
            name = "alarm_shutdown",
            address = 18,
            type = "u8",
            width = 1,
            scale = 1.0,
            bits = {
              [0] = "input_voltage",
              [1] = "stroke_limit",
              [2] = "overheating",
              [3] = "range",
              [4] = "checksum",
              [5] = "overload",
              [6] = "instruction",
            },
          },
          {
            name = "resolution_factor",
            address = 22,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[1] = "4096", [2] = "2048", [3] = "1024", [4] = "512"},
            selects = true,
          },
          {
            name = "third_party_program_interface",
            address = 30,
            type = "u16le",
            width = 2,
            scale = 1.0,
          },
          {
            name = "third_party_firmware_version",
            address = 32,
            type = "u8",
            width = 1,
            scale = 1.0,
          },
          {name = "d_gain", address = 37, type = "u8", width = 1, scale = 1.0},
          {name = "i_gain", address = 38, type = "u8", width = 1, scale = 1.0},
          {name = "p_gain", address = 39, type = "u8", width = 1, scale = 1.0},
          {
            name = "short_stroke_pulse_width",
            address = 40,
            type = "u16le",
            width = 2,
            unit = "us",
            scale = 1.0,
          },
          {
            name = "long_stroke_pulse_width",
            address = 42,
            type = "u16le",
            width = 2,
            unit = "us",
            scale = 1.0,
          },
          {
            name = "middle_stroke_pulse_width",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "us",
            scale = 1.0,
          },
          {
            name = "center_difference",
            address = 50,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
          },
          {name = "punch_initial_value", address = 52, type = "u16le", width = 2, scale = 1.0},
          {
            name = "force_on",
            address = 128,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on"},
          },
          {
            name = "led",
            address = 129,
            type = "u8",
            width = 1,
            scale = 1.0,
            bits = {[0] = "disable", [1] = "red", [2] = "green", [3] = "blue"},
          },
          {
            name = "short_stroke_compliance_margin",
            address = 130,
            type = "u8",
            width = 1,
            scale = 1.0,
          },
          {
            name = "long_stroke_compliance_margin",
            address = 131,
            type = "u8",
            width = 1,
            scale = 1.0,
          },
          {
            name = "goal_position",
            address = 134,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
            by = "resolution_factor",
            scales = {
              [1] = 0.007326007326007326,
              [2] = 0.014655593551538837,
              [3] = 0.02932551319648094,
              [4] = 0.05870841487279843,
            },
            limits = {[1] = 4504.5, [2] = 2251.7000000000003, [3] = 1125.3, [4] = 562.1},
          },
          {
            name = "moving_speed",
            address = 136,
            type = "u16le",
            width = 2,
            scale = 1.0,
            special = {[0] = "maximum"},
          },
          {name = "force_limit", address = 138, type = "u16le", width = 2, scale = 1.0},
          {
            name = "present_position",
            address = 140,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
            by = "resolution_factor",
            scales = {
              [1] = 0.007326007326007326,
              [2] = 0.014655593551538837,
              [3] = 0.02932551319648094,
              [4] = 0.05870841487279843,
            },
            limits = {[1] = 4504.5, [2] = 2251.7000000000003, [3] = 1125.3, [4] = 562.1},
          },
          {
            name = "present_speed",
            address = 142,
            type = "u16le",
            width = 2,
            scale = 1.0,
            sign_bit = 10,
          },
          {
            name = "present_load",
            address = 144,
            type = "u16le",
            width = 2,
            scale = 1.0,
            sign_bit = 10,
          },
          {
            name = "present_voltage",
            address = 146,
            type = "u8",
            width = 1,
            unit = "V",
            scale = 0.1,
          },
          {
            name = "present_temperature",
            address = 147,
            type = "u8",
            width = 1,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "received_data",
            address = 148,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "not_received", [1] = "received"},
          },
          {
            name = "moving",
            address = 150,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "completed", [1] = "moving"},
          },
          {
            name = "lock",
            address = 151,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "unlocked", [1] = "locked"},
          },
          {name = "punch", address = 152, type = "u16le", width = 2, scale = 1.0},
        },
      },
      {
        name = "mightyzap-12lf",
        registers = {
          {name = "model_number", address = 0, type = "u16le", width = 2, scale = 1.0},
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 3,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "baud_rate",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[16] = "115200", [32] = "57600", [48] = "38400", [64] = "19200", [128] = "9600"},
            effect = "baud",
          },
          {
            name = "short_stroke_limit",
            address = 6,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
          },
          {
            name = "long_stroke_limit",
            address = 8,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
          },
          {
            name = "protocol_type",
            address = 10,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "modbus_rtu", [1] = "ir_protocol"},
          },
          {
            name = "lowest_limit_voltage",
            address = 12,
            type = "u8",
            width = 1,
            unit = "V",
            scale = 0.1,
          },
          {
            name = "highest_limit_voltage",
            address = 13,
            type = "u8",
            width = 1,
            unit = "V",
            scale = 0.1,
          },
          {name = "motor_operating_rate", address = 14, type = "u16le", width = 2, scale = 1.0},
          {
            name = "feedback_return_mode",
            address = 16,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "none_except_echo", [1] = "load_data", [2] = "all"},
            effect = "feedback",
          },
          {
            name = "alarm_led",
            address = 17,
            type = "u8",
            width = 1,
            scale = 1.0,
            bits = {[0] = "input_voltage", [5] = "overload"},
          },
          {
            name = "alarm_shutdown",
            address = 18,
            type = "u8",
            width = 1,
            scale = 1.0,
            bits = {[0] = "input_voltage", [5] = "overload"},
          },
          {name = "start_compliance_margin", address = 19, type = "u8", width = 1, scale = 1.0},
          {name = "end_compliance_margin", address = 20, type = "u8", width = 1, scale = 1.0},
          {name = "speed_limit", address = 21, type = "u16le", width = 2, scale = 1.0},
          {
            name = "calibration_short_stroke",
            address = 24,
            type = "u16le",
            width = 2,
            scale = 1.0,
          },
          {
            name = "calibration_long_stroke",
            address = 26,
            type = "u16le",
            width = 2,
            scale = 1.0,
          },
          {name = "acceleration_ratio", address = 33, type = "u8", width = 1, scale = 1.0},
          {name = "deceleration_ratio", address = 34, type = "u8", width = 1, scale = 1.0},
          {name = "current_i_gain", address = 35, type = "u8", width = 1, scale = 1.0},
          {name = "current_p_gain", address = 36, type = "u8", width = 1, scale = 1.0},
          {name = "speed_d_gain", address = 37, type = "u8", width = 1, scale = 1.0},
          {name = "speed_i_gain", address = 38, type = "u8", width = 1, scale = 1.0},
          {name = "speed_p_gain", address = 39, type = "u8", width = 1, scale = 1.0},
          {
            name = "min_position_calibration",
            address = 46,
            type = "u8",
            width = 1,
            scale = 1.0,
          },
          {
            name = "max_position_calibration",
            address = 47,
            type = "u8",
            width = 1,
            scale = 1.0,
          },
          {
            name = "current_limit",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "force_on",
            address = 128,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on"},
          },
          {
            name = "led",
            address = 129,
            type = "u8",
            width = 1,
            scale = 1.0,
            bits = {[0] = "disable", [1] = "red", [2] = "green"},
          },
          {
            name = "goal_position",
            address = 134,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
          },
          {name = "goal_speed", address = 136, type = "u16le", width = 2, scale = 1.0},
          {
            name = "goal_current",
            address = 138,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 140,
            type = "u16le",
            width = 2,
            unit = "mm",
            scale = 0.007326007326007326,
          },
          {
            name = "present_current",
            address = 142,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_motor_operating_rate",
            address = 144,
            type = "u16le",
            width = 2,
            scale = 1.0,
            sign_bit = 10,
          },
          {
            name = "present_voltage",
            address = 146,
            type = "u8",
            width = 1,
            unit = "V",
            scale = 0.1,
          },
          {
            name = "moving",
            address = 150,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "stopped", [1] = "moving"},
          },
        },
      },
    },
    style = "packets",
    header = "\255\255\255",
    sum_from = 3,
    fold = "sum",
    least = 7,
    size_at = 4,
    extra = 5,
    id_at = 3,
    code_at = 5,
    status_at = 5,
    body_at = 6,
    answer = "feedback",
    silent = {[254] = true},
    anyone = {[0] = true},
    servo_id = 3,
    status = {},
    status_bits = {
      [0] = "input_voltage",
      [1] = "stroke_limit",
      [2] = "overheating",
      [3] = "range",
      [4] = "checksum",
      [5] = "overload",
      [6] = "instruction",
    },
    refusals = {8, 16, 64},
    commands = {
      [241] = {name = "echo", least = 0, most = 0, fixed = 0},
      [242] = {
        name = "load_data",
        least = 2,
        most = 2,
        fixed = 2,
        address = 0,
        length = 1,
        reads = true,
      },
      [243] = {name = "store_data", least = 2, fixed = 1, address = 0, writes = true},
      [244] = {name = "send_data", least = 2, fixed = 1, address = 0, writes = true},
      [245] = {name = "execution", least = 0, most = 0, fixed = 0},
      [246] = {
        name = "factory_reset",
        least = 1,
        most = 1,
        fixed = 1,
        option = 0,
        new_id = {1, 0},
        resets = true,
      },
      [248] = {name = "restart", least = 0, most = 0, fixed = 0},
      [249] = {
        name = "mightyzap_factory_reset",
        least = 1,
        most = 1,
        fixed = 1,
        option = 0,
        new_id = {1, 0},
        resets = true,
      },
      [115] = {
        name = "symmetric_store",
        reply = "never",
        least = 3,
        fixed = 2,
        address = 0,
        length = 1,
        targets = true,
      },
    },
  },
  [2] = {
    name = "lss",
    title = "Lynxmotion Smart Servo (LSS)",
    baud = 115200,
    reach = 512,
    tail = 0.25,
    everyone = {[254] = true},
    models = {
      {
        name = "lss",
        registers = {
          {name = "limp", type = "none", width = 0, scale = 1.0},
          {name = "halt_and_hold", type = "none", width = 0, scale = 1.0},
          {name = "relative_move", type = "decimal", width = 8, unit = "deg", scale = 0.1},
          {name = "origin_offset", type = "decimal", width = 8, unit = "deg", scale = 0.1},
          {
            name = "configured_origin_offset",
            type = "decimal",
            width = 8,
            unit = "deg",
            scale = 0.1,
          },
          {name = "angular_range", type = "decimal", width = 8, unit = "deg", scale = 0.1},
          {
            name = "configured_angular_range",
            type = "decimal",
            width = 8,
            unit = "deg",
            scale = 0.1,
          },
          {name = "goal_position_pulse", type = "decimal", width = 8, unit = "us", scale = 1.0},
          {
            name = "present_position_pulse",
            type = "decimal",
            width = 8,
            unit = "us",
            scale = 1.0,
            special = {[-500] = "below_500", [-2500] = "above_2500"},
          },
          {name = "goal_position", type = "decimal", width = 8, unit = "deg", scale = 0.1},
          {name = "present_position", type = "decimal", width = 8, unit = "deg", scale = 0.1},
          {name = "target_position", type = "decimal", width = 8, unit = "deg", scale = 0.1},
          {name = "wheel_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.1},
          {name = "present_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.1},
          {
            name = "wheel_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {
            name = "present_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {name = "max_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.1},
          {
            name = "configured_max_speed",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 0.1,
          },
          {name = "target_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.1},
          {name = "max_speed_in_rpm", type = "decimal", width = 8, unit = "deg/s", scale = 6.0},
          {
            name = "configured_max_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {
            name = "target_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {
            name = "led_color",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {
              [0] = "off",
              [1] = "red",
              [2] = "green",
              [3] = "blue",
              [4] = "yellow",
              [5] = "cyan",
              [6] = "magenta",
              [7] = "white",
            },
          },
          {
            name = "configured_led_color",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {
              [0] = "off",
              [1] = "red",
              [2] = "green",
              [3] = "blue",
              [4] = "yellow",
              [5] = "cyan",
              [6] = "magenta",
              [7] = "white",
            },
          },
          {
            name = "gyre_direction",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[1] = "cw", [-1] = "ccw"},
          },
          {
            name = "configured_gyre_direction",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[1] = "cw", [-1] = "ccw"},
          },
          {name = "servo_id", type = "decimal", width = 8, scale = 1.0, effect = "servo_id"},
          {
            name = "baud_rate",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {
              [9600] = "9600",
              [19200] = "19200",
              [38400] = "38400",
              [57600] = "57600",
              [115200] = "115200",
              [230400] = "230400",
              [250000] = "250000",
              [460800] = "460800",
              [500000] = "500000",
            },
            effect = "baud",
          },
          {
            name = "first_position_pulse",
            type = "decimal",
            width = 8,
            unit = "us",
            scale = 1.0,
          },
          {name = "first_position", type = "decimal", width = 8, unit = "deg", scale = 0.1},
          {
            name = "rc_mode",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "serial", [1] = "rc_position", [2] = "rc_wheel", [3] = "serial"},
          },
          {name = "reset", type = "none", width = 0, scale = 1.0},
          {name = "restore_defaults", type = "none", width = 0, scale = 1.0},
          {name = "firmware_update", type = "none", width = 0, scale = 1.0},
          {name = "confirm", type = "none", width = 0, scale = 1.0},
          {name = "model_string", type = "text", width = 0, scale = 1.0, identifies = true},
          {name = "serial_number", type = "decimal", width = 8, scale = 1.0},
          {name = "firmware_version", type = "decimal", width = 8, scale = 1.0},
          {
            name = "present_status",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {
              [0] = "unknown",
              [1] = "limp",
              [2] = "free_moving",
              [3] = "accelerating",
              [4] = "traveling",
              [5] = "decelerating",
              [6] = "holding",
              [7] = "outside_limits",
              [8] = "stuck",
              [9] = "blocked",
              [10] = "safe_mode",
            },
          },
          {
            name = "safe_mode_cause",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "none", [1] = "current", [2] = "input_voltage", [3] = "temperature"},
          },
          {name = "present_voltage", type = "decimal", width = 8, unit = "V", scale = 0.001},
          {
            name = "present_temperature",
            type = "decimal",
            width = 8,
            unit = "degC",
            scale = 0.1,
          },
          {name = "present_current", type = "decimal", width = 8, unit = "mA", scale = 1.0},
          {name = "angular_stiffness", type = "decimal", width = 8, scale = 1.0},
          {name = "configured_angular_stiffness", type = "decimal", width = 8, scale = 1.0},
          {name = "angular_holding_stiffness", type = "decimal", width = 8, scale = 1.0},
          {
            name = "configured_angular_holding_stiffness",
            type = "decimal",
            width = 8,
            scale = 1.0,
          },
          {name = "angular_acceleration", type = "decimal", width = 8, scale = 1.0},
          {name = "configured_angular_acceleration", type = "decimal", width = 8, scale = 1.0},
          {name = "angular_deceleration", type = "decimal", width = 8, scale = 1.0},
          {name = "configured_angular_deceleration", type = "decimal", width = 8, scale = 1.0},
          {
            name = "motion_control",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "disabled", [1] = "enabled"},
          },
          {
            name = "led_blinking",
            type = "decimal",
            width = 8,
            scale = 1.0,
            bits = {
              [0] = "limp",
              [1] = "holding",
              [2] = "accelerating",
              [3] = "decelerating",
              [4] = "free",
              [5] = "travelling",
            },
          },
          {name = "move_time", type = "decimal", width = 8, unit = "s", scale = 0.001},
          {name = "move_speed_pulse", type = "decimal", width = 8, unit = "us/s", scale = 1.0},
          {name = "move_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.1},
          {name = "current_hold", type = "decimal", width = 8, unit = "mA", scale = 1.0},
          {name = "current_limp", type = "decimal", width = 8, unit = "mA", scale = 1.0},
          {
            name = "present_speed_pulse",
            type = "decimal",
            width = 8,
            unit = "us/s",
            scale = 1.0,
          },
          {name = "present_position_mv", type = "decimal", width = 8, scale = 1.0},
          {name = "analog_input", type = "decimal", width = 8, scale = 1.0},
          {name = "analog_distance", type = "decimal", width = 8, unit = "mm", scale = 1.0},
          {name = "qvt", type = "decimal", width = 8, scale = 1.0},
          {
            name = "configured_motion_control",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "disabled", [1] = "enabled"},
          },
          {name = "filter_position_count", type = "decimal", width = 8, scale = 1.0},
          {name = "configured_filter_position_count", type = "decimal", width = 8, scale = 1.0},
          {name = "maximum_motor_duty", type = "decimal", width = 8, scale = 1.0},
          {name = "rdm", type = "decimal", width = 8, scale = 1.0},
          {name = "hd", type = "none", width = 0, scale = 1.0},
          {name = "chd", type = "none", width = 0, scale = 1.0},
          {name = "ln", type = "none", width = 0, scale = 1.0},
          {name = "lp", type = "none", width = 0, scale = 1.0},
          {name = "le", type = "none", width = 0, scale = 1.0},
          {name = "cln", type = "none", width = 0, scale = 1.0},
          {name = "csl", type = "none", width = 0, scale = 1.0},
          {name = "ipe", type = "none", width = 0, scale = 1.0},
          {name = "po", type = "none", width = 0, scale = 1.0},
          {name = "is", type = "none", width = 0, scale = 1.0},
          {name = "ris", type = "none", width = 0, scale = 1.0},
          {name = "cr", type = "none", width = 0, scale = 1.0},
          {name = "tq", type = "none", width = 0, scale = 1.0},
          {name = "tqt", type = "none", width = 0, scale = 1.0},
          {name = "tqm", type = "none", width = 0, scale = 1.0},
          {name = "y", type = "none", width = 0, scale = 1.0},
          {name = "m", type = "none", width = 0, scale = 1.0},
          {name = "mm", type = "none", width = 0, scale = 1.0},
        },
      },
      {
        name = "lss-pro",
        registers = {
          {name = "reset", type = "none", width = 0, scale = 1.0},
          {name = "restore_defaults", type = "none", width = 0, scale = 1.0},
          {name = "firmware_update", type = "none", width = 0, scale = 1.0},
          {name = "confirm", type = "none", width = 0, scale = 1.0},
          {name = "servo_id", type = "decimal", width = 8, scale = 1.0, effect = "servo_id"},
          {
            name = "can_terminal",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "disabled", [1] = "enabled"},
          },
          {
            name = "usb_connection",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "not_connected", [1] = "connected"},
          },
          {name = "firmware_release", type = "decimal", width = 8, scale = 1.0},
          {name = "limp", type = "none", width = 0, scale = 1.0},
          {name = "halt_and_hold", type = "none", width = 0, scale = 1.0},
          {name = "goal_position", type = "decimal", width = 8, unit = "deg", scale = 0.01},
          {name = "present_position", type = "decimal", width = 8, unit = "deg", scale = 0.01},
          {name = "target_position", type = "decimal", width = 8, unit = "deg", scale = 0.01},
          {name = "relative_move", type = "decimal", width = 8, unit = "deg", scale = 0.01},
          {name = "wheel_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.01},
          {name = "present_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.01},
          {name = "current_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.01},
          {
            name = "wheel_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {
            name = "present_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {name = "max_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.01},
          {
            name = "configured_max_speed",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 0.01,
          },
          {name = "target_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.01},
          {name = "max_speed_in_rpm", type = "decimal", width = 8, unit = "deg/s", scale = 6.0},
          {
            name = "configured_max_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {
            name = "target_speed_in_rpm",
            type = "decimal",
            width = 8,
            unit = "deg/s",
            scale = 6.0,
          },
          {name = "angular_acceleration", type = "decimal", width = 8, scale = 1.0},
          {name = "configured_angular_acceleration", type = "decimal", width = 8, scale = 1.0},
          {name = "angular_deceleration", type = "decimal", width = 8, scale = 1.0},
          {name = "configured_angular_deceleration", type = "decimal", width = 8, scale = 1.0},
          {
            name = "motion_control",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "disabled", [1] = "enabled"},
          },
          {
            name = "configured_motion_control",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "disabled", [1] = "enabled"},
          },
          {
            name = "step_mode",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[1] = "full_step", [2] = "half_step", [4] = "quarter_step"},
          },
          {
            name = "configured_step_mode",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[1] = "full_step", [2] = "half_step", [4] = "quarter_step"},
          },
          {name = "origin_offset", type = "decimal", width = 8, unit = "deg", scale = 0.01},
          {
            name = "configured_origin_offset",
            type = "decimal",
            width = 8,
            unit = "deg",
            scale = 0.01,
          },
          {name = "angular_range", type = "decimal", width = 8, unit = "deg", scale = 0.01},
          {
            name = "configured_angular_range",
            type = "decimal",
            width = 8,
            unit = "deg",
            scale = 0.01,
          },
          {
            name = "gyre_direction",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[1] = "cw", [-1] = "ccw"},
          },
          {
            name = "configured_gyre_direction",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[1] = "cw", [-1] = "ccw"},
          },
          {name = "first_position", type = "decimal", width = 8, unit = "deg", scale = 0.01},
          {
            name = "present_status",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {
              [0] = "unknown",
              [1] = "limp",
              [2] = "accelerating",
              [3] = "traveling",
              [4] = "decelerating",
              [5] = "holding",
              [6] = "error",
            },
          },
          {
            name = "safe_mode_cause",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {[0] = "none", [1] = "current", [2] = "input_voltage", [3] = "temperature"},
          },
          {
            name = "error_flags",
            type = "decimal",
            width = 8,
            scale = 1.0,
            bits = {
              [0] = "pcb_over_temperature",
              [1] = "mcu_over_temperature",
              [2] = "motor_probe_over_temperature",
              [3] = "motor_driver_over_temperature",
              [4] = "blocked",
              [5] = "exceeds_speed_limit",
              [6] = "exceeds_acceleration_limit",
              [7] = "exceeds_deceleration_limit",
              [8] = "position_out_of_range_plus",
              [9] = "position_out_of_range_minus",
              [10] = "eeprom_header_error",
              [11] = "eeprom_checksum_error",
              [12] = "eeprom_map_version_not_supported",
            },
          },
          {name = "present_voltage", type = "decimal", width = 8, unit = "V", scale = 0.001},
          {
            name = "present_temperature",
            type = "decimal",
            width = 8,
            unit = "degC",
            scale = 0.1,
          },
          {name = "motor_temperature", type = "decimal", width = 8, unit = "degC", scale = 0.1},
          {name = "mcu_temperature", type = "decimal", width = 8, unit = "degC", scale = 0.1},
          {name = "driver_temperature_warning", type = "decimal", width = 8, scale = 1.0},
          {name = "driver_temperature_error", type = "decimal", width = 8, scale = 1.0},
          {name = "present_current", type = "decimal", width = 8, unit = "mA", scale = 1.0},
          {name = "model_string", type = "text", width = 0, scale = 1.0, identifies = true},
          {name = "serial_number", type = "decimal", width = 8, scale = 1.0},
          {name = "firmware_version", type = "decimal", width = 8, scale = 1.0},
          {name = "linear_acceleration_x", type = "decimal", width = 8, scale = 1.0},
          {name = "linear_acceleration_y", type = "decimal", width = 8, scale = 1.0},
          {name = "linear_acceleration_z", type = "decimal", width = 8, scale = 1.0},
          {name = "angular_acceleration_alpha", type = "decimal", width = 8, scale = 1.0},
          {name = "angular_acceleration_beta", type = "decimal", width = 8, scale = 1.0},
          {name = "angular_acceleration_gamma", type = "decimal", width = 8, scale = 1.0},
          {
            name = "led_color",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {
              [0] = "off",
              [1] = "red",
              [2] = "green",
              [3] = "blue",
              [4] = "yellow",
              [5] = "cyan",
              [6] = "magenta",
              [7] = "white",
            },
          },
          {
            name = "configured_led_color",
            type = "decimal",
            width = 8,
            scale = 1.0,
            values = {
              [0] = "off",
              [1] = "red",
              [2] = "green",
              [3] = "blue",
              [4] = "yellow",
              [5] = "cyan",
              [6] = "magenta",
              [7] = "white",
            },
          },
          {name = "led_blinking", type = "decimal", width = 8, scale = 1.0},
          {name = "move_time", type = "decimal", width = 8, unit = "s", scale = 0.001},
          {name = "move_speed", type = "decimal", width = 8, unit = "deg/s", scale = 0.01},
          {name = "jaw_opening", type = "none", width = 0, scale = 1.0},
          {name = "jaw_opening_deg", type = "none", width = 0, scale = 1.0},
          {name = "jaw_opening_offset", type = "none", width = 0, scale = 1.0},
        },
      },
    },
    style = "lss",
    all = 254,
    button = 255,
    words = {
      L = {name = "L", registers = {[1] = 1, [2] = 95}},
      H = {name = "H", registers = {[1] = 2, [2] = 96}},
      MD = {name = "MD", registers = {[1] = 3, [2] = 100}},
      O = {name = "O", registers = {[1] = 4, [2] = 120}},
      CO = {name = "CO", registers = {[1] = 5, [2] = 121}},
      AR = {name = "AR", registers = {[1] = 6, [2] = 122}},
      CAR = {name = "CAR", registers = {[1] = 7, [2] = 123}},
      P = {name = "P", registers = {[1] = 8}},
      D = {name = "D", registers = {[1] = 10, [2] = 97}},
      PD = {name = "D", registers = {[1] = 10, [2] = 97}},
      WD = {name = "WD", registers = {[1] = 13, [2] = 101}},
      WR = {name = "WR", registers = {[1] = 15, [2] = 104}},
      SD = {name = "SD", registers = {[1] = 17, [2] = 106}},
      CSD = {name = "CSD", registers = {[1] = 18, [2] = 107}},
      SR = {name = "SR", registers = {[1] = 20, [2] = 109}},
      CSR = {name = "CSR", registers = {[1] = 21, [2] = 110}},
      LED = {name = "LED", registers = {[1] = 23, [2] = 146}},
      CLED = {name = "CLED", registers = {[1] = 24, [2] = 147}},
      G = {name = "G", registers = {[1] = 25, [2] = 124}},
      CG = {name = "CG", registers = {[1] = 26, [2] = 125}},
      CID = {name = "CID", registers = {[1] = 27, [2] = 91}},
      CB = {name = "CB", registers = {[1] = 28}},
      CFP = {name = "CFP", registers = {[1] = 29}},
      CP = {name = "CFP", registers = {[1] = 29}},
      CFD = {name = "CFD", registers = {[1] = 30, [2] = 126}},
      CD = {name = "CFD", registers = {[1] = 30, [2] = 126}},
      CRC = {name = "CRC", registers = {[1] = 31}},
      RESET = {name = "RESET", registers = {[1] = 32, [2] = 87}},
      RS = {name = "RESET", registers = {[1] = 32, [2] = 87}},
      DEFAULT = {name = "DEFAULT", registers = {[1] = 33, [2] = 88}},
      UPDATE = {name = "UPDATE", registers = {[1] = 34, [2] = 89}},
      CONFIRM = {name = "CONFIRM", registers = {[1] = 35, [2] = 90}},
      AS = {name = "AS", registers = {[1] = 44}},
      CAS = {name = "CAS", registers = {[1] = 45}},
      AH = {name = "AH", registers = {[1] = 46}},
      CAH = {name = "CAH", registers = {[1] = 47}},
      AA = {name = "AA", registers = {[1] = 48, [2] = 112}},
      CAA = {name = "CAA", registers = {[1] = 49, [2] = 113}},
      AD = {name = "AD", registers = {[1] = 50, [2] = 114}},
      CAD = {name = "CAD", registers = {[1] = 51, [2] = 115}},
      EM = {name = "EM", registers = {[1] = 52, [2] = 116}},
      CLB = {name = "CLB", registers = {[1] = 53, [2] = 148}},
      CEM = {name = "CEM", registers = {[1] = 64, [2] = 117}},
      FPC = {name = "FPC", registers = {[1] = 65}},
      CFPC = {name = "CFPC", registers = {[1] = 66}},
      MMD = {name = "MMD", registers = {[1] = 67}},
      RDM = {name = "RDM", registers = {[1] = 68}},
      HD = {name = "HD", registers = {[1] = 69}},
      CHD = {name = "CHD", registers = {[1] = 70}},
      LN = {name = "LN", registers = {[1] = 71}},
      LP = {name = "LP", registers = {[1] = 72}},
      LE = {name = "LE", registers = {[1] = 73}},
      CLN = {name = "CLN", registers = {[1] = 74}},
      CSL = {name = "CSL", registers = {[1] = 75}},
      SCSL = {name = "CSL", registers = {[1] = 75}},
      IPE = {name = "IPE", registers = {[1] = 76}},
      PO = {name = "PO", registers = {[1] = 77}},
      IS = {name = "IS", registers = {[1] = 78}},
      RIS = {name = "RIS", registers = {[1] = 79}},
      CR = {name = "CR", registers = {[1] = 80}},
      TQ = {name = "TQ", registers = {[1] = 81}},
      TQT = {name = "TQT", registers = {[1] = 82}},
      TQM = {name = "TQM", registers = {[1] = 83}},
      Y = {name = "Y", registers = {[1] = 84}},
      M = {name = "M", registers = {[1] = 85}},
      MM = {name = "MM", registers = {[1] = 86}},
      CET = {name = "CET", registers = {[1] = 92, [2] = 92}},
      SM = {name = "SM", registers = {[1] = 118, [2] = 118}},
      CSM = {name = "CSM", registers = {[1] = 119, [2] = 119}},
      J = {name = "J", registers = {[1] = 151, [2] = 151}},
      JD = {name = "JD", registers = {[1] = 152, [2] = 152}},
      JO = {name = "JO", registers = {[1] = 153, [2] = 153}},
      QO = {name = "QO", query = true, answers = {{[0] = 4, [1] = 5}, {[0] = 120, [1] = 121}}},
      QAR = {name = "QAR", query = true, answers = {{[0] = 6, [1] = 7}, {[0] = 122, [1] = 123}}},
      QP = {name = "QP", query = true, plain = true, answers = {{[0] = 9}, {}}},
      QD = {name = "QD", query = true, plain = true, answers = {{[0] = 11}, {[0] = 98}}},
      QDT = {name = "QDT", query = true, plain = true, answers = {{[0] = 12}, {[0] = 99}}},
      QWD = {name = "QWD", query = true, plain = true, answers = {{[0] = 14}, {[0] = 102}}},
      QSD = {
        name = "QSD",
        query = true,
        answers = {
          {[2] = 14, [0] = 17, [1] = 18, [3] = 19},
          {[2] = 102, [0] = 106, [1] = 107, [3] = 108},
        },
      },
      QWR = {name = "QWR", query = true, plain = true, answers = {{[0] = 16}, {[0] = 105}}},
      QSR = {
        name = "QSR",
        query = true,
        answers = {
          {[2] = 16, [0] = 20, [1] = 21, [3] = 22},
          {[2] = 105, [0] = 109, [1] = 110, [3] = 111},
        },
      },
      QLED = {name = "QLED", query = true, answers = {{[0] = 23, [1] = 24}, {[0] = 146, [1] = 147}}},
      QG = {name = "QG", query = true, answers = {{[0] = 25, [1] = 26}, {[0] = 124, [1] = 125}}},
      QID = {
        name = "QID",
        query = true,
        plain = true,
        answers = {{[0] = 27, [1] = 27}, {[0] = 91, [1] = 91}},
      },
      QB = {name = "QB", query = true, plain = true, answers = {{[0] = 28, [1] = 28}, {}}},
      QFP = {name = "QFP", query = true, plain = true, answers = {{[0] = 29, [1] = 29}, {}}},
      QFD = {
        name = "QFD",
        query = true,
        plain = true,
        answers = {{[0] = 30, [1] = 30}, {[0] = 126, [1] = 126}},
      },
      QMS = {
        name = "QMS",
        query = true,
        plain = true,
        identifies = true,
        answers = {{[0] = 36}, {[0] = 137}},
      },
      QN = {name = "QN", query = true, plain = true, answers = {{[0] = 37}, {[0] = 138}}},
      QF = {
        name = "QF",
        query = true,
        plain = true,
        answers = {{[0] = 38, [3] = 38}, {[0] = 139, [3] = 139}},
      },
      Q = {name = "Q", query = true, answers = {{[0] = 39, [1] = 40}, {[0] = 127, [1] = 128}}},
      QV = {name = "QV", query = true, plain = true, answers = {{[0] = 41}, {[0] = 130}}},
      QT = {name = "QT", query = true, plain = true, answers = {{[0] = 42}, {[0] = 131}}},
      QC = {name = "QC", query = true, plain = true, answers = {{[0] = 43}, {[0] = 136}}},
      QAS = {name = "QAS", query = true, answers = {{[0] = 44, [1] = 45}, {}}},
      QAH = {name = "QAH", query = true, answers = {{[0] = 46, [1] = 47}, {}}},
      QAA = {name = "QAA", query = true, answers = {{[0] = 48, [1] = 49}, {[0] = 112, [1] = 113}}},
      QAD = {name = "QAD", query = true, answers = {{[0] = 50, [1] = 51}, {[0] = 114, [1] = 115}}},
      QEM = {name = "QEM", query = true, answers = {{[0] = 52, [1] = 64}, {[0] = 116, [1] = 117}}},
      QLB = {
        name = "QLB",
        query = true,
        plain = true,
        answers = {{[0] = 53, [1] = 53}, {[0] = 148, [1] = 148}},
      },
      QS = {name = "QS", query = true, plain = true, answers = {{[0] = 59}, {}}},
      QPMV = {name = "QPMV", query = true, plain = true, answers = {{[0] = 60}, {}}},
      QA = {name = "QA", query = true, answers = {{[0] = 61, [1] = 62, [2] = 62, [3] = 62}, {}}},
      QVT = {name = "QVT", query = true, plain = true, answers = {{[0] = 63}, {}}},
      QFPC = {name = "QFPC", query = true, answers = {{[0] = 65, [1] = 66}, {}}},
      QMMD = {name = "QMMD", query = true, plain = true, answers = {{[0] = 67}, {}}},
      QRDM = {name = "QRDM", query = true, plain = true, answers = {{[0] = 68}, {}}},
      QET = {
        name = "QET",
        query = true,
        plain = true,
        answers = {{[0] = 92, [1] = 92}, {[0] = 92, [1] = 92}},
      },
      QUC = {name = "QUC", query = true, plain = true, answers = {{[0] = 93}, {[0] = 93}}},
      QFR = {name = "QFR", query = true, plain = true, answers = {{[0] = 94}, {[0] = 94}}},
      QCS = {name = "QCS", query = true, plain = true, answers = {{[0] = 103}, {[0] = 103}}},
      QM = {name = "QM", query = true, plain = true, answers = {{[0] = 118}, {[0] = 118}}},
      QEF = {name = "QEF", query = true, plain = true, answers = {{[0] = 129}, {[0] = 129}}},
      QTP = {name = "QTP", query = true, plain = true, answers = {{[0] = 132}, {[0] = 132}}},
      QTM = {name = "QTM", query = true, plain = true, answers = {{[0] = 133}, {[0] = 133}}},
      QTCW = {name = "QTCW", query = true, plain = true, answers = {{[0] = 134}, {[0] = 134}}},
      QTCE = {name = "QTCE", query = true, plain = true, answers = {{[0] = 135}, {[0] = 135}}},
      QIX = {name = "QIX", query = true, plain = true, answers = {{[0] = 140}, {[0] = 140}}},
      QIY = {name = "QIY", query = true, plain = true, answers = {{[0] = 141}, {[0] = 141}}},
      QIZ = {name = "QIZ", query = true, plain = true, answers = {{[0] = 142}, {[0] = 142}}},
      QIA = {name = "QIA", query = true, plain = true, answers = {{[0] = 143}, {[0] = 143}}},
      QIB = {name = "QIB", query = true, plain = true, answers = {{[0] = 144}, {[0] = 144}}},
      QIG = {name = "QIG", query = true, plain = true, answers = {{[0] = 145}, {[0] = 145}}},
      QIC = {name = "QIC", query = true, plain = true, answers = {{[0] = 145}, {[0] = 145}}},
    },
    modifiers = {
      T = {[1] = 54, [2] = 149},
      S = {[1] = 55},
      SD = {[1] = 56, [2] = 150},
      CH = {[1] = 57},
      CL = {[1] = 58},
    },
    text_words = {"QMS", "QFD", "QFP", "QF", "QN"},
    names = {
      {
        texts = {["LSS-ST1"] = true, ["LSS-HS1"] = true, ["LSS-HT1"] = true},
        begins = {"LSS-ST", "LSS-HS", "LSS-HT"},
      },
      {
        texts = {["LSS-P-L1"] = true, ["LSS-P-S1"] = true, ["LSS-P-M1"] = true},
        begins = {"LSS-P-"},
      },
    },
  },
  [3] = {
    name = "rs30x",
    title = "Futaba RS30x (RS305CR)",
    baud = 115200,
    reach = 263,
    tail = 0.1,
    everyone = {[255] = true},
    watches = {},
    numbers = {[12368] = 1, [8256] = 2, [12304] = 3, [12320] = 4, [12336] = 5, [12352] = 6},
    models = {
      {
        name = "rs305cr",
        registers = {
          {
            name = "model_number",
            address = 0,
            type = "u16le",
            width = 2,
            scale = 1.0,
            values = {
              [12368] = "rs305cr",
              [8256] = "rs204md",
              [12304] = "rs301cr",
              [12320] = "rs302cd",
              [12336] = "rs303mr",
              [12352] = "rs304md",
            },
            identifies = true,
          },
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.01},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
            special = {[5555] = "dead_band"},
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
      {
        name = "rs204md",
        registers = {
          {
            name = "model_number",
            address = 0,
            type = "u16le",
            width = 2,
            scale = 1.0,
            values = {
              [12368] = "rs305cr",
              [8256] = "rs204md",
              [12304] = "rs301cr",
              [12320] = "rs302cd",
              [12336] = "rs303mr",
              [12352] = "rs304md",
            },
            identifies = true,
          },
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "torque_in_silence",
            address = 22,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "free", [1] = "hold", [2] = "brake"},
          },
          {
            name = "warm_up_time",
            address = 23,
            type = "u8",
            width = 1,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.4},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "pid_coefficient",
            address = 38,
            type = "u8",
            width = 1,
            unit = "%",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
      {
        name = "rs301cr",
        registers = {
          {
            name = "model_number",
            address = 0,
            type = "u16le",
            width = 2,
            scale = 1.0,
            values = {
              [12368] = "rs305cr",
              [8256] = "rs204md",
              [12304] = "rs301cr",
              [12320] = "rs302cd",
              [12336] = "rs303mr",
              [12352] = "rs304md",
            },
            identifies = true,
          },
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
              [10] = "460800",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {name = "torque_in_silence", address = 22, type = "u8", width = 1, scale = 1.0},
          {
            name = "warm_up_time",
            address = 23,
            type = "u8",
            width = 1,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.01},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "pid_coefficient",
            address = 38,
            type = "u8",
            width = 1,
            unit = "%",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
      {
        name = "rs302cd",
        registers = {
          {
            name = "model_number",
            address = 0,
            type = "u16le",
            width = 2,
            scale = 1.0,
            values = {
              [12368] = "rs305cr",
              [8256] = "rs204md",
              [12304] = "rs301cr",
              [12320] = "rs302cd",
              [12336] = "rs303mr",
              [12352] = "rs304md",
            },
            identifies = true,
          },
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
              [10] = "460800",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {name = "torque_in_silence", address = 22, type = "u8", width = 1, scale = 1.0},
          {
            name = "warm_up_time",
            address = 23,
            type = "u8",
            width = 1,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.01},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "pid_coefficient",
            address = 38,
            type = "u8",
            width = 1,
            unit = "%",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
      {
        name = "rs303mr",
        registers = {
          {
            name = "model_number",
            address = 0,
            type = "u16le",
            width = 2,
            scale = 1.0,
            values = {
              [12368] = "rs305cr",
              [8256] = "rs204md",
              [12304] = "rs301cr",
              [12320] = "rs302cd",
              [12336] = "rs303mr",
              [12352] = "rs304md",
            },
            identifies = true,
          },
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
              [10] = "460800",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "torque_in_silence",
            address = 22,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "free", [1] = "hold", [2] = "brake"},
          },
          {
            name = "warm_up_time",
            address = 23,
            type = "u8",
            width = 1,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.01},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "pid_coefficient",
            address = 38,
            type = "u8",
            width = 1,
            unit = "%",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
      {
        name = "rs304md",
        registers = {
          {
            name = "model_number",
            address = 0,
            type = "u16le",
            width = 2,
            scale = 1.0,
            values = {
              [12368] = "rs305cr",
              [8256] = "rs204md",
              [12304] = "rs301cr",
              [12320] = "rs302cd",
              [12336] = "rs303mr",
              [12352] = "rs304md",
            },
            identifies = true,
          },
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
              [10] = "460800",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "torque_in_silence",
            address = 22,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "free", [1] = "hold", [2] = "brake"},
          },
          {
            name = "warm_up_time",
            address = 23,
            type = "u8",
            width = 1,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.01},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "pid_coefficient",
            address = 38,
            type = "u8",
            width = 1,
            unit = "%",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
      {
        name = "rs405cb",
        registers = {
          {name = "model_number", address = 0, type = "u16le", width = 2, scale = 1.0},
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
              [10] = "460800",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {name = "damper", address = 20, type = "u8", width = 1, scale = 1.0},
          {
            name = "torque_in_silence",
            address = 22,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "free", [1] = "hold", [2] = "brake"},
          },
          {
            name = "warm_up_time",
            address = 23,
            type = "u8",
            width = 1,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.01},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "pid_coefficient",
            address = 38,
            type = "u8",
            width = 1,
            unit = "%",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
      {
        name = "rs406cb",
        registers = {
          {name = "model_number", address = 0, type = "u16le", width = 2, scale = 1.0},
          {name = "firmware_version", address = 2, type = "u8", width = 1, scale = 1.0},
          {
            name = "servo_id",
            address = 4,
            type = "u8",
            width = 1,
            scale = 1.0,
            effect = "servo_id",
          },
          {
            name = "reverse",
            address = 5,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "normal", [1] = "reverse"},
          },
          {
            name = "baud_rate",
            address = 6,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "9600",
              [1] = "14400",
              [2] = "19200",
              [3] = "28800",
              [4] = "38400",
              [5] = "57600",
              [6] = "76800",
              [7] = "115200",
              [8] = "153600",
              [9] = "230400",
              [10] = "460800",
            },
            effect = "baud",
          },
          {name = "return_delay", address = 7, type = "u8", width = 1, scale = 1.0},
          {
            name = "cw_angle_limit",
            address = 8,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_angle_limit",
            address = 10,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "temperature_limit",
            address = 14,
            type = "u16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {name = "damper", address = 20, type = "u8", width = 1, scale = 1.0},
          {
            name = "torque_in_silence",
            address = 22,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "free", [1] = "hold", [2] = "brake"},
          },
          {
            name = "warm_up_time",
            address = 23,
            type = "u8",
            width = 1,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "cw_compliance_margin",
            address = 24,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "ccw_compliance_margin",
            address = 25,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "cw_compliance_slope",
            address = 26,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {
            name = "ccw_compliance_slope",
            address = 27,
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0,
          },
          {name = "punch", address = 28, type = "u16le", width = 2, unit = "%", scale = 0.01},
          {
            name = "goal_position",
            address = 30,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "goal_time",
            address = 32,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {name = "max_torque", address = 35, type = "u8", width = 1, unit = "%", scale = 1.0},
          {
            name = "torque_enable",
            address = 36,
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[0] = "off", [1] = "on", [2] = "brake"},
          },
          {
            name = "pid_coefficient",
            address = 38,
            type = "u8",
            width = 1,
            unit = "%",
            scale = 1.0,
          },
          {
            name = "present_position",
            address = 42,
            type = "i16le",
            width = 2,
            unit = "deg",
            scale = 0.1,
          },
          {
            name = "present_time",
            address = 44,
            type = "u16le",
            width = 2,
            unit = "s",
            scale = 0.01,
          },
          {
            name = "present_speed",
            address = 46,
            type = "i16le",
            width = 2,
            unit = "deg/s",
            scale = 1.0,
          },
          {
            name = "present_current",
            address = 48,
            type = "u16le",
            width = 2,
            unit = "mA",
            scale = 1.0,
          },
          {
            name = "present_temperature",
            address = 50,
            type = "i16le",
            width = 2,
            unit = "degC",
            scale = 1.0,
          },
          {
            name = "present_voltage",
            address = 52,
            type = "u16le",
            width = 2,
            unit = "V",
            scale = 0.01,
          },
        },
      },
    },
    style = "rs30x",
    header = "\250\175",
    sum_from = 2,
    fold = "xor8",
    least = 8,
    back = "\253\223",
    ack = 7,
    nack = 256,
    ack_token = 65536,
    long = 0,
    all = 255,
    reset = 16,
    command_address = 255,
    servo_id = 4,
    default_id = 1,
    status_at = 3,
    status = {[256] = "nack"},
    status_bits = {
      [1] = "packet_not_processable",
      [3] = "flash_write_error",
      [5] = "temperature_alarm",
      [7] = "temperature_limit",
    },
    refusals = {2, 8, 256},
    replies = {
      [1] = {[1] = -1, [2] = -1, ack = true},
      [3] = {[1] = 0, [2] = 30},
      [5] = {[1] = 30, [2] = 30},
      [7] = {[1] = 20, [2] = 10},
      [9] = {[1] = 42, [2] = 18},
      [11] = {[1] = 30, [2] = 12},
      [13] = {[1] = 60, [2] = 68},
      [15] = {[1] = -1, [2] = -1, own = true},
    },
    flags = {{64, "flash_write"}, {32, "reboot"}, {16, "factory_reset"}},
  },
  [4] = {
    name = "wck",
    title = "RoboBuilder wCK",
    baud = 115200,
    reach = 0,
    tail = 0.5,
    ordered = true,
    everyone = {[-1] = true},
    models = {
      {
        name = "wck",
        registers = {
          {
            name = "goal_position",
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0549019607843138,
          },
          {name = "position", type = "u8", width = 1, unit = "deg", scale = 1.0549019607843138},
          {
            name = "goal_position_10bit",
            type = "u16be",
            width = 2,
            unit = "deg",
            scale = 0.3255131964809384,
          },
          {
            name = "position_10bit",
            type = "u16be",
            width = 2,
            unit = "deg",
            scale = 0.3255131964809384,
          },
          {name = "load", type = "u8", width = 1, scale = 1.0},
          {
            name = "torque_level",
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "maximum",
              [1] = "level 1",
              [2] = "level 2",
              [3] = "level 3",
              [4] = "minimum",
            },
          },
          {name = "torque_10bit", type = "u8", width = 1, scale = 1.0},
          {
            name = "wheel_direction",
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {[3] = "ccw", [4] = "cw"},
          },
          {name = "wheel_speed", type = "u8", width = 1, scale = 1.0},
          {name = "rotation_count", type = "u8", width = 1, scale = 1.0},
          {name = "servo_id", type = "u8", width = 1, scale = 1.0, effect = "servo_id"},
          {
            name = "baud_rate",
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [0] = "921600",
              [1] = "460800",
              [3] = "230400",
              [7] = "115200",
              [15] = "57600",
              [23] = "38400",
              [95] = "9600",
              [191] = "4800",
            },
            effect = "baud",
          },
          {name = "p_gain", type = "u8", width = 1, scale = 1.0},
          {name = "d_gain", type = "u8", width = 1, scale = 1.0},
          {name = "i_gain", type = "u8", width = 1, scale = 1.0},
          {name = "runtime_p_gain", type = "u8", width = 1, scale = 1.0},
          {name = "runtime_d_gain", type = "u8", width = 1, scale = 1.0},
          {name = "runtime_i_gain", type = "u8", width = 1, scale = 1.0},
          {name = "speed", type = "u8", width = 1, scale = 1.0, special = {[0] = "no_limit"}},
          {name = "acceleration", type = "u8", width = 1, scale = 1.0},
          {
            name = "runtime_speed",
            type = "u8",
            width = 1,
            scale = 1.0,
            special = {[0] = "no_limit"},
          },
          {name = "runtime_acceleration", type = "u8", width = 1, scale = 1.0},
          {
            name = "overload",
            type = "u8",
            width = 1,
            scale = 1.0,
            values = {
              [33] = "400 mA",
              [44] = "500 mA",
              [56] = "600 mA",
              [68] = "700 mA",
              [80] = "800 mA",
              [92] = "900 mA",
              [104] = "1000 mA",
              [116] = "1100 mA",
              [128] = "1200 mA",
              [199] = "1800 mA",
            },
          },
          {
            name = "lower_boundary",
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0549019607843138,
          },
          {
            name = "upper_boundary",
            type = "u8",
            width = 1,
            unit = "deg",
            scale = 1.0549019607843138,
          },
          {
            name = "digital_output",
            type = "u8",
            width = 1,
            scale = 1.0,
            bits = {[0] = "output_1", [1] = "output_2"},
          },
          {name = "ad_input", type = "u8", width = 1, scale = 1.0},
          {name = "motion_count", type = "u8", width = 1, scale = 1.0},
        },
      },
    },
    style = "wck",
    header = 255,
    controller = "\255\255\170\085\170\085\055\186",
    types = {
      [11] = "rbc_read_zero_positions",
      [12] = "rbc_read_serial_number",
      [14] = "rbc_set_zero_positions",
      [15] = "rbc_read_free_memory",
      [16] = "rbc_direct_control_begin",
      [18] = "rbc_read_firmware_version",
      [20] = "rbc_play_motion",
      [21] = "rbc_play_sound",
      [22] = "rbc_read_distance",
      [23] = "rbc_wait_for_sound",
      [24] = "rbc_wait_for_button",
      [25] = "rbc_wait_for_remote_control",
      [26] = "rbc_read_acceleration",
      [30] = "rbc_read_execution_status",
      [31] = "rbc_erase_memory",
    },
    ops = {
      {
        name = "position_move",
        firsts = {0, 30, 32, 62, 64, 94, 96, 126, 128, 158},
        seconds = {0, 254},
        least = 4,
        most = 4,
        reply = true,
        sum_from = 1,
        out = {{reg = 6, at = 1, shift = 5, mask = 7}, {reg = 1, at = 2}},
        back = {{reg = 5, at = 0}, {reg = 2, at = 1}},
      },
      {
        name = "sync_position_move",
        firsts = {31, 31, 63, 63, 95, 95, 127, 127, 159, 159},
        seconds = {1, 31, 33, 63, 65, 95, 97, 127, 129, 159, 161, 191, 193, 223, 225, 255},
        least = 5,
        nobody = true,
        sum_from = 3,
        counted = {
          [1] = {{reg = 6, at = 1, shift = 5, mask = 7, servo = 0}, {reg = 1, at = 3, servo = 0}},
          [2] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
          },
          [3] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
          },
          [4] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
          },
          [5] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
          },
          [6] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
          },
          [7] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
          },
          [8] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
          },
          [9] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
          },
          [10] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
          },
          [11] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
          },
          [12] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
          },
          [13] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
          },
          [14] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
          },
          [15] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
          },
          [16] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
          },
          [17] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
          },
          [18] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
          },
          [19] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
          },
          [20] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
          },
          [21] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
          },
          [22] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
          },
          [23] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
          },
          [24] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
          },
          [25] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 24},
            {reg = 1, at = 27, servo = 24},
          },
          [26] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 24},
            {reg = 1, at = 27, servo = 24},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 25},
            {reg = 1, at = 28, servo = 25},
          },
          [27] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 24},
            {reg = 1, at = 27, servo = 24},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 25},
            {reg = 1, at = 28, servo = 25},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 26},
            {reg = 1, at = 29, servo = 26},
          },
          [28] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 24},
            {reg = 1, at = 27, servo = 24},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 25},
            {reg = 1, at = 28, servo = 25},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 26},
            {reg = 1, at = 29, servo = 26},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 27},
            {reg = 1, at = 30, servo = 27},
          },
          [29] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 24},
            {reg = 1, at = 27, servo = 24},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 25},
            {reg = 1, at = 28, servo = 25},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 26},
            {reg = 1, at = 29, servo = 26},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 27},
            {reg = 1, at = 30, servo = 27},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 28},
            {reg = 1, at = 31, servo = 28},
          },
          [30] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 24},
            {reg = 1, at = 27, servo = 24},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 25},
            {reg = 1, at = 28, servo = 25},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 26},
            {reg = 1, at = 29, servo = 26},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 27},
            {reg = 1, at = 30, servo = 27},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 28},
            {reg = 1, at = 31, servo = 28},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 29},
            {reg = 1, at = 32, servo = 29},
          },
          [31] = {
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 0},
            {reg = 1, at = 3, servo = 0},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 1},
            {reg = 1, at = 4, servo = 1},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 2},
            {reg = 1, at = 5, servo = 2},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 3},
            {reg = 1, at = 6, servo = 3},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 4},
            {reg = 1, at = 7, servo = 4},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 5},
            {reg = 1, at = 8, servo = 5},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 6},
            {reg = 1, at = 9, servo = 6},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 7},
            {reg = 1, at = 10, servo = 7},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 8},
            {reg = 1, at = 11, servo = 8},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 9},
            {reg = 1, at = 12, servo = 9},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 10},
            {reg = 1, at = 13, servo = 10},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 11},
            {reg = 1, at = 14, servo = 11},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 12},
            {reg = 1, at = 15, servo = 12},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 13},
            {reg = 1, at = 16, servo = 13},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 14},
            {reg = 1, at = 17, servo = 14},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 15},
            {reg = 1, at = 18, servo = 15},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 16},
            {reg = 1, at = 19, servo = 16},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 17},
            {reg = 1, at = 20, servo = 17},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 18},
            {reg = 1, at = 21, servo = 18},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 19},
            {reg = 1, at = 22, servo = 19},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 20},
            {reg = 1, at = 23, servo = 20},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 21},
            {reg = 1, at = 24, servo = 21},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 22},
            {reg = 1, at = 25, servo = 22},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 23},
            {reg = 1, at = 26, servo = 23},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 24},
            {reg = 1, at = 27, servo = 24},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 25},
            {reg = 1, at = 28, servo = 25},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 26},
            {reg = 1, at = 29, servo = 26},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 27},
            {reg = 1, at = 30, servo = 27},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 28},
            {reg = 1, at = 31, servo = 28},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 29},
            {reg = 1, at = 32, servo = 29},
            {reg = 6, at = 1, shift = 5, mask = 7, servo = 30},
            {reg = 1, at = 33, servo = 30},
          },
        },
        back = {},
      },
      {
        name = "status_read",
        firsts = {160, 190},
        seconds = {0, 255},
        least = 4,
        most = 4,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 5, at = 0}, {reg = 2, at = 1}},
      },
      {
        name = "passive",
        firsts = {192, 222},
        seconds = {16, 31},
        least = 4,
        most = 4,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 2, at = 1}},
      },
      {
        name = "wheel",
        firsts = {192, 222},
        seconds = {48, 79},
        least = 4,
        most = 4,
        reply = true,
        sum_from = 1,
        out = {{reg = 8, at = 2, shift = 4, mask = 15}, {reg = 9, at = 2, mask = 15}},
        back = {{reg = 10, at = 0}, {reg = 2, at = 1}},
      },
      {
        name = "break",
        firsts = {223, 223},
        seconds = {32, 47},
        least = 4,
        most = 4,
        reply = true,
        nobody = true,
        sum_from = 1,
        out = {},
        back = {{reg = 2, at = 1}},
      },
      {
        name = "baud_rate_set",
        firsts = {224, 254},
        seconds = {8, 8},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 12, at = 3}},
        back = {{reg = 12, at = 0}},
      },
      {
        name = "pd_gain_set",
        firsts = {224, 254},
        seconds = {9, 9},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 13, at = 3}, {reg = 14, at = 4}},
        back = {{reg = 13, at = 0}, {reg = 14, at = 1}},
      },
      {
        name = "pd_gain_read",
        firsts = {224, 254},
        seconds = {10, 10},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 13, at = 0}, {reg = 14, at = 1}},
      },
      {
        name = "i_gain_set",
        firsts = {224, 254},
        seconds = {21, 21},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 15, at = 3}},
        back = {{reg = 15, at = 0}},
      },
      {
        name = "i_gain_read",
        firsts = {224, 254},
        seconds = {22, 22},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 15, at = 0}},
      },
      {
        name = "runtime_pd_gain_set",
        firsts = {224, 254},
        seconds = {11, 11},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 16, at = 3}, {reg = 17, at = 4}},
        back = {{reg = 16, at = 0}, {reg = 17, at = 1}},
      },
      {
        name = "runtime_i_gain_set",
        firsts = {224, 254},
        seconds = {24, 24},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 18, at = 3}},
        back = {{reg = 18, at = 0}},
      },
      {
        name = "id_set",
        firsts = {224, 254},
        seconds = {12, 12},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 11, at = 3}},
        back = {{reg = 11, at = 0}},
      },
      {
        name = "speed_set",
        firsts = {224, 254},
        seconds = {13, 13},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 19, at = 3}, {reg = 20, at = 4}},
        back = {{reg = 19, at = 0}, {reg = 20, at = 1}},
      },
      {
        name = "speed_read",
        firsts = {224, 254},
        seconds = {14, 14},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 19, at = 0}, {reg = 20, at = 1}},
      },
      {
        name = "runtime_speed_set",
        firsts = {224, 254},
        seconds = {23, 23},
        least = 6,
        most = 6,
        sum_from = 1,
        out = {{reg = 21, at = 3}, {reg = 22, at = 4}},
        back = {},
      },
      {
        name = "overload_set",
        firsts = {224, 254},
        seconds = {15, 15},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 23, at = 3}},
        back = {{reg = 23, at = 0}},
      },
      {
        name = "overload_read",
        firsts = {224, 254},
        seconds = {16, 16},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 23, at = 0}},
      },
      {
        name = "boundary_set",
        firsts = {224, 254},
        seconds = {17, 17},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 24, at = 3}, {reg = 25, at = 4}},
        back = {{reg = 24, at = 0}, {reg = 25, at = 1}},
      },
      {
        name = "boundary_read",
        firsts = {224, 254},
        seconds = {18, 18},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 24, at = 0}, {reg = 25, at = 1}},
      },
      {
        name = "io_write",
        firsts = {224, 254},
        seconds = {100, 100},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {{reg = 26, at = 3, mask = 3}},
        back = {{reg = 26, at = 0, mask = 3}},
      },
      {
        name = "io_read",
        firsts = {224, 254},
        seconds = {101, 101},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 26, at = 0, mask = 3}, {reg = 27, at = 1}},
      },
      {
        name = "motion_data_write",
        firsts = {224, 254},
        seconds = {150, 150},
        least = 5,
        reply = true,
        sum_from = 1,
        out = {{reg = 28, at = 3}},
        back = {{reg = 28, at = 0}},
      },
      {
        name = "motion_data_read",
        firsts = {224, 254},
        seconds = {151, 151},
        least = 6,
        most = 6,
        reply = true,
        sum_from = 1,
        out = {},
        back = {{reg = 28, at = 0}},
      },
      {
        name = "rbc_direct_control_end",
        firsts = {224, 224},
        seconds = {251, 251},
        least = 6,
        most = 6,
        nobody = true,
        sum_from = 1,
        out = {},
        back = {},
      },
      {
        name = "position_move_10bit",
        firsts = {224, 255},
        seconds = {200, 200},
        least = 8,
        most = 8,
        reply = true,
        id_at = 3,
        sum_from = 1,
        out = {{reg = 7, at = 4}, {reg = 3, at = 5, ten = true}},
        back = {{reg = 4, at = 0, ten = true}},
      },
      {
        name = "position_read_10bit",
        firsts = {224, 255},
        seconds = {201, 201},
        least = 6,
        most = 6,
        reply = true,
        id_at = 3,
        sum_from = 1,
        text_sum = true,
        out = {},
        back = {{reg = 4, at = 0, ten = true}},
      },
      {
        name = "unknown",
        firsts = {224, 254},
        seconds = {0, 7, 19, 20, 25, 99, 102, 149, 152, 199, 202, 254},
        least = 6,
        most = 6,
        reply = true,
        unknown = true,
        sum_from = 1,
        out = {},
        back = {},
      },
    },
  },
}

---------------------------------------------------------------------------------- numbers and bits

local floor, byte, sub, format = math.floor, string.byte, string.sub, string.format

local bxor = (bit and bit.bxor) or (bit32 and bit32.bxor)
  or (load or loadstring)("return function(a, b) return a ~ b end")()

local function has(number, mask)  -- one bit of a number, by its mask
  return floor(number / mask) % 2 == 1
end

local function bits_of(number, shift, mask)  -- `mask` is one less than a power of two
  return floor(number / 2 ^ shift) % (mask + 1)
end

local FOLDS = {
  sum = function(raw, first, last)
    local s = 0
    for i = first, last do s = s + byte(raw, i) end
    return 255 - s % 256
  end,
  xor8 = function(raw, first, last)
    local s = 0
    for i = first, last do s = bxor(s, byte(raw, i)) end
    return s
  end,
}
FOLDS.xor7 = function(raw, first, last) return FOLDS.xor8(raw, first, last) % 128 end

local READS = {  -- a number at `i` (the first byte is 1), by the type names of the tables
  u8 = function(raw, i) return byte(raw, i) end,
  i8 = function(raw, i) local v = byte(raw, i); return v < 128 and v or v - 256 end,
  u16le = function(raw, i) local a, b = byte(raw, i, i + 1); return a + b * 256 end,
  u16be = function(raw, i) local a, b = byte(raw, i, i + 1); return b + a * 256 end,
}
READS.i16le = function(raw, i) local v = READS.u16le(raw, i); return v < 32768 and v or v - 65536 end
READS.i16be = function(raw, i) local v = READS.u16be(raw, i); return v < 32768 and v or v - 65536 end
READS.u32 = function(raw, i) return READS.u16le(raw, i) + READS.u16le(raw, i + 2) * 65536 end
READS.i32 = function(raw, i) local v = READS.u32(raw, i); return v < 2 ^ 31 and v or v - 2 ^ 32 end

-------------------------------------------------------------------------------------------- fields

local F = P.fields
local KINDS = {[0] = "request", [1] = "response", [2] = "no frame"}
local GOOD = {[0] = "bad", [1] = "good", [2] = "none"}
F.protocol = ProtoField.string("servo.protocol", "Protocol")
F.kind = ProtoField.uint8("servo.kind", "Kind", base.DEC, KINDS)
F.id = ProtoField.uint8("servo.id", "Servo")
F.op = ProtoField.string("servo.op", "Command")
F.status = ProtoField.uint16("servo.status", "Status", base.HEX)
F.status_name = ProtoField.string("servo.status.name", "Reports")
F.addr = ProtoField.uint16("servo.addr", "Address")
F.count = ProtoField.uint16("servo.count", "Bytes asked for")
F.data = ProtoField.bytes("servo.data", "Data")
F.target = ProtoField.uint8("servo.target", "Of servo")
F.checksum = ProtoField.uint8("servo.checksum", "Checksum", base.HEX)
F.sum_status = ProtoField.uint8("servo.checksum.status", "Checksum status", base.DEC, GOOD)
F.sum_bad = ProtoField.bool("servo.checksum.bad", "Checksum does not hold")
F.response_in = ProtoField.framenum("servo.response_in", "Response in", base.NONE,
  frametype.RESPONSE)
F.response_to = ProtoField.framenum("servo.response_to", "Response to", base.NONE,
  frametype.REQUEST)
F.refused = ProtoField.bool("servo.refused", "Refused by the servo")
F.outcome = ProtoField.string("servo.outcome", "Outcome")
F.rtt = ProtoField.double("servo.rtt", "Response time [s]")
F.rtt_unsure = ProtoField.double("servo.rtt.uncertainty", "Uncertainty of the response time [s]")
F.register = ProtoField.string("servo.register", "Register")
F.raw = ProtoField.int64("servo.raw", "Raw value")
F.text = ProtoField.string("servo.text", "Text")
F.model = ProtoField.string("servo.model", "Read by the table of")

local E_SUM = ProtoExpert.new("servo.expert.checksum", "The checksum does not hold",
  expert.group.CHECKSUM, expert.severity.ERROR)
local E_STATUS = ProtoExpert.new("servo.expert.status", "The servo reports an error",
  expert.group.RESPONSE_CODE, expert.severity.WARN)
local E_GAP = ProtoExpert.new("servo.expert.no_frame", "Bytes that no frame claims",
  expert.group.MALFORMED, expert.severity.WARN)
local E_UNASKED = ProtoExpert.new("servo.expert.unsolicited", "An answer that nobody asked for",
  expert.group.SEQUENCE, expert.severity.WARN)
P.experts = {E_SUM, E_STATUS, E_GAP, E_UNASKED}

for name in pairs(NAMES) do
  NAMES[name] = ProtoField.double("servo.reg." .. name, (name:gsub("_", " ")))
  F["reg_" .. name] = NAMES[name]
end

for _, spec in pairs(PROTOCOLS) do
  for _, model in ipairs(spec.models) do
    model.owner = {}
    for _, reg in ipairs(model.registers) do
      reg.field = NAMES[reg.name]
      reg.read = READS[reg.type]
      for k = 0, (reg.address and reg.width or 0) - 1 do model.owner[reg.address + k] = reg end
    end
  end
  if #spec.models > 1 then
    local choices = {{0, "as the bus tells", 0}}
    for m, model in ipairs(spec.models) do choices[#choices + 1] = {m, model.name, m} end
    spec.chosen = "model_" .. spec.name
    P.prefs[spec.chosen] = Pref.enum("Model of " .. spec.name .. " servos", 0,
      "The register table by which their values are read", choices)
  end
end

------------------------------------------------------------------------------- what servos told

-- Kept by bus: for each servo the model its number or name tells and the registers that select a
-- scale. Tables are never changed, only replaced, so that a frame can keep the one it was read by.

local MODEL_OF_NOBODY = {}

local function told_of(state, id) return state.servos[id] or MODEL_OF_NOBODY end

local function with(state, id, key, value)
  local servos, one = {}, {}
  for k, v in pairs(state.servos) do servos[k] = v end
  for k, v in pairs(told_of(state, id)) do one[k] = v end
  one[key] = value
  servos[id] = one
  return {servos = servos, low = state.low, high = state.high}
end

local function model_of(spec, state, id)  -- its number; the first is assumed
  local chosen = spec.chosen and P.prefs[spec.chosen] or 0
  return chosen > 0 and chosen or told_of(state, id).model or 1
end

local function value_of(state, id, reg, raw)  -- nil: none in units
  if reg.special and reg.special[raw] then return nil end
  if reg.scales then
    local mode = told_of(state, id)[reg.by]
    if not mode then return raw * reg.scale end
    local scale = reg.scales[mode]
    return scale and raw * scale
  end
  if reg.sign_bit then
    local half = 2 ^ reg.sign_bit
    local size = raw % half
    if not has(raw, half) then size = -size end
    return (size == 0 and 0 or size) * reg.scale
  end
  return raw * reg.scale
end

local function name_of(reg, raw)  -- what a number means, in words
  if reg.special and reg.special[raw] then return reg.special[raw] end
  if reg.bits then
    local out = {}
    for k = 0, 31 do
      if has(raw % 2 ^ 32, 2 ^ k) then out[#out + 1] = reg.bits[k] or ("bit" .. k) end
    end
    return table.concat(out, " ")
  end
  return reg.values and (reg.values[raw] or "unknown")
end

-- A value in a frame: {servo, register, at (from 0), width, raw, part, loose}; `part` where a packet
-- has but some bytes of a register, which is no value, `loose` where a register that selects a scale
-- stands among bytes that its table has no name for: then it may be none.
local function span(spec, state, out, raw, servo, address, at, length)
  local model = spec.models[model_of(spec, state, servo)]
  local a, stop = address, address + length
  while a < stop do
    local reg = model.owner[a]
    if not reg then a = a + 1 else
      local last = math.min(reg.address + reg.width, stop)
      local here = at + a - address
      if a == reg.address and last == reg.address + reg.width then
        out[#out + 1] = {servo, reg, here, reg.width, reg.read(raw, here + 1)}
        if reg.selects then
          for b = address, stop - 1 do
            if not model.owner[b] then out[#out][7] = true end
          end
        end
      else
        out[#out + 1] = {servo, reg, here, 1, byte(raw, here + 1), true}
      end
      a = last
    end
  end
end

-- What a frame tells that changes how later ones are read.
local function heard(spec, state, frame, values)
  for _, v in ipairs(values) do
    local servo, reg, raw = v[1], v[2], v[5]
    if not v[6] then
      if frame.kind == 1 and spec.numbers and reg.identifies and spec.numbers[raw] then
        if told_of(state, servo).model ~= spec.numbers[raw] then
          state = with(state, servo, "model", spec.numbers[raw])
        end
      elseif reg.selects and told_of(state, servo)[reg.name] ~= raw
        and (not v[7] or (frame.kind == 1 and told_of(state, servo).model)) then
        state = with(state, servo, reg.name, raw)
        if spec.everyone[servo] then
          for id in pairs(state.servos) do state = with(state, id, reg.name, raw) end
        end
      elseif reg.scales then
        -- a position far outside the stroke: the scale it was read by cannot be
        local mode = told_of(state, servo)[reg.by]
        if mode and reg.limits and reg.limits[mode] and raw > reg.limits[mode] then
          state = with(state, servo, reg.by, nil)
        end
      elseif frame.kind == 0 and reg.effect == "servo_id" and state.servos[servo] then
        local servos = {}
        for k, one in pairs(state.servos) do servos[k] = one end
        servos[raw] = state.servos[servo]
        state = {servos = servos, low = state.low, high = state.high}
      end
    end
  end
  return state
end

------------------------------------------------------------------------------ packets of one form

-- Each protocol's `describe(spec, raw, kind)` returns a frame, nil where the bytes are none:
--   id, op        the servo's, nil where the frame names none; the command's name
--   asks, many    a request that is answered, by all servos one after the other
--   token         what an answer must have in common with its request; nil in an answer: any
--   alt           the other id that may answer, true: any
--   address, status, count, sum ({right, sent})
--   itself        an answer that says itself what its values are
-- and `values(spec, state, frame, raw)` returns what it says of registers; `frame.asked` is the
-- request of an answer.

local describe, values_in = {}, {}

function describe.packets(spec, raw, kind)
  local n = #raw
  if n < spec.least or sub(raw, 1, #spec.header) ~= spec.header then return nil end
  if n ~= byte(raw, spec.size_at + 1) + spec.extra then return nil end
  local id, code = byte(raw, spec.id_at + 1), byte(raw, spec.code_at + 1)
  local params = n - spec.body_at - 1
  local f = {id = id, kind = kind, sum = {FOLDS[spec.fold](raw, spec.sum_from + 1, n - 1), byte(raw, n)}}
  f.data_at, f.data_length, f.id_at, f.op_at = spec.body_at, params, spec.id_at, spec.code_at
  if kind == 1 then
    f.op, f.status = spec.answer, code
    f.token = params
    if code > 0 and params == 0 then f.token = nil end
    return f
  end
  local cmd = spec.commands[code]
  f.op = cmd and cmd.name or format("unknown_%02x", code)
  f.asks = not spec.silent[id] and (not cmd or cmd.reply ~= "never")
  f.token = 0
  f.alt = spec.anyone[id] or nil
  if not cmd or params < cmd.least or (cmd.most and params > cmd.most) then return f end
  f.command = cmd
  local first = spec.body_at + 1
  if cmd.address then f.address = byte(raw, first + cmd.address) end
  if cmd.length then f.count = byte(raw, first + cmd.length) end
  if cmd.reads then f.token = f.count end
  if cmd.writes then
    local at = (spec.servo_id or -1) - f.address
    if at >= 0 and at < params - cmd.fixed and not f.alt then
      f.alt = byte(raw, first + cmd.fixed + at)
    end
  end
  if cmd.option and cmd.new_id and not f.alt then
    local bit_mask, new = cmd.new_id[1], cmd.new_id[2]
    if has(byte(raw, first + cmd.option), bit_mask) then f.alt = new end
  end
  f.resets = cmd.resets
  return f
end

function values_in.packets(spec, state, f, raw)
  local out, cmd = {}, f.command
  if f.kind == 1 then
    local asked = f.asked
    if asked and asked.address and asked.command and asked.command.reads then
      span(spec, state, out, raw, f.id, asked.address, f.data_at, f.data_length)
    end
  elseif cmd and cmd.writes then
    span(spec, state, out, raw, f.id, f.address, f.data_at + cmd.fixed, f.data_length - cmd.fixed)
  elseif cmd and cmd.targets and f.count then
    local at = f.data_at + cmd.fixed
    while f.count > 0 and at + 1 + f.count <= f.data_at + f.data_length do
      span(spec, state, out, raw, byte(raw, at + 1), f.address, at + 1, f.count)
      at = at + 1 + f.count
    end
  end
  return out
end

-------------------------------------------------------------------------------------------- RS30x

function describe.rs30x(spec, raw, kind)
  local n = #raw
  if n == 1 then
    local status = byte(raw, 1) ~= spec.ack and spec.nack or nil
    return {kind = 1, op = "ack", token = spec.ack_token, status = status, bare = true}
  end
  if n < spec.least then return nil end
  local id, flags, address, length, count = byte(raw, 3, 7)
  local due = spec.least + length * count
  if n ~= due and not (n == due + 1 and due == spec.least and has(flags, spec.reset)) then
    return nil
  end
  local f = {id = id, kind = kind, sum = {FOLDS[spec.fold](raw, 3, n - 1), byte(raw, n)}}
  f.data_at, f.data_length, f.id_at, f.op_at = spec.least - 1, n - spec.least, 2, spec.status_at
  if kind == 1 then
    if sub(raw, 1, 2) ~= spec.back then return nil end
    f.op, f.status, f.address, f.itself = "return", flags, address, true
    f.token = address * 256 + length
    return f
  end
  if sub(raw, 1, 2) ~= spec.header then return nil end
  local nibble, data = flags % 16, f.data_length
  local form = spec.replies[nibble]
  for _, one in ipairs(spec.flags) do
    if not f.op and has(flags, one[1]) then f.op = one[2] end
  end
  local plain = not f.op
  if plain then
    f.op = nibble > 0 and data == 0 and "read" or id == spec.long and "long_write" or "write"
  end
  local alone = id ~= spec.long and id ~= spec.all
  f.asks = nibble > 0 and alone and plain
  if form then
    local from, size = form[1], form[2]
    if form.own then from, size = address, length end
    f.token = form.ack and spec.ack_token or from * 256 + size
    if f.op == "read" and not form.ack then f.address, f.count = from, size end
  else
    f.token = -1
  end
  local carries = not plain and data > 0 and address ~= spec.command_address and id ~= spec.long
  if f.op == "write" or f.op == "long_write" or carries then f.address = address end
  if f.op == "write" or carries then f.sets = data > 0 and count == 1 end
  if f.op == "long_write" then f.sets = length >= 2 and data > 0 and data % length == 0 end
  f.block = length
  if form and form.ack then f.alt = true
  elseif f.op == "write" then
    local at = spec.servo_id - address
    if at >= 0 and at < data then f.alt = byte(raw, 8 + at) end
  elseif f.op == "factory_reset" and alone then f.alt = spec.default_id end
  return f
end

function values_in.rs30x(spec, state, f, raw)
  local out = {}
  if f.bare or (f.kind == 0 and not f.sets) then return out end
  if f.op == "long_write" and f.kind == 0 then
    for at = f.data_at, f.data_at + f.data_length - f.block, f.block do
      span(spec, state, out, raw, byte(raw, at + 1), f.address, at + 1, f.block - 1)
    end
  else
    span(spec, state, out, raw, f.id, f.address, f.data_at, f.data_length)
  end
  return out
end

---------------------------------------------------------------------------------------------- LSS

local function query_form(word)
  return (sub(word, 1, 1) == "Q" or #word == 13) and word or "Q" .. word
end

local function text_reply(spec, raw)  -- a query's word, the longest first, and a text behind it
  local id, at = raw:match("^%*(%d+)()")
  if not id then return nil end
  for _, word in ipairs(spec.text_words) do
    local text = sub(raw, at + #word, -2)
    if sub(raw, at, at + #word - 1):upper() == word and text:match("^[^%c#%*\128-\255]+$") then
      return id, word, text, at + #word
    end
  end
end

function describe.lss(spec, raw, kind)
  local f = {kind = kind}
  if kind == 0 then
    local id, word, at, number, rest = raw:match("^#(%d+)(%a+)()(%-?%d*)(.-)\r$")
    if not id then return nil end
    local sent = word:upper()
    local known = spec.words[sent]
    f.id, f.op, f.word, f.number = tonumber(id), known and known.name or sent, known, tonumber(number)
    f.token, f.at, f.width = query_form(sent), at - 1, #number
    f.id_at, f.id_width, f.op_at, f.op_width = 1, #id, 1 + #id, #word
    if known and known.query then
      f.asks, f.many = true, f.id == spec.all
      if number ~= "" and rest == "" and f.number >= 0 then f.address = f.number end
      f.number = nil
    else
      f.asks = not known and sub(sent, 1, 1) == "Q"
      f.modifiers = {}
      local where = at + #number
      for name, value in rest:gmatch("(%a+)(%d+)") do
        f.modifiers[#f.modifiers + 1] = {name:upper(), tonumber(value), where + #name - 1, #value}
        where = where + #name + #value
      end
    end
    if f.asks and (f.id == spec.all or f.id == spec.button) then f.alt = true end
    return f
  end
  local id, word, at, number = raw:match("^%*(%d+)(%a+)()(%-?%d*)\r$")
  if not id or not (spec.words[query_form(word:upper())] or {}).query then
    local own, long, text, where = text_reply(spec, raw)
    if own then id, word, at, number, f.text = own, long, where, "", text end
  end
  if not id then
    id, at = raw:match("^%*[Qq][Ii][Dd]()(%d+)\r$")
    if not id then return nil end
    id, at, number, word = at, id, at, "QID"
  end
  f.id, f.op = tonumber(id), query_form(word:upper())
  f.token, f.at, f.number = f.op, at - 1, tonumber(number)
  f.width = f.text and #f.text or #number
  f.word = spec.words[f.op]
  f.itself = f.word and f.word.plain
  return f
end

function values_in.lss(spec, state, f)
  local out = {}
  local word = f.asked and f.asked.word or f.word
  if not word then return out end
  local m = model_of(spec, state, f.id)
  local index = word.registers and word.registers[m]
  if f.kind == 1 then
    local selector = f.asked and f.asked.address or 0
    index = word.answers and word.answers[m][selector]
  end
  local reg = index and spec.registers[index]
  if reg and f.number and reg.type == "decimal" then
    out[1] = {f.id, reg, f.at, f.width, f.number}
  end
  for _, one in ipairs(f.modifiers or out) do
    local of = spec.modifiers[one[1]]
    if of and of[m] then
      out[#out + 1] = {f.id, spec.registers[of[m]], one[3], one[4], one[2]}
    end
  end
  return out
end

-- The model, by the text with which a servo answers which it is.
local function named(spec, state, f)
  local word = f.asked and f.asked.word or f.word
  if not (f.text and word and word.identifies) then return state end
  for m, told in ipairs(spec.names) do
    local is = told.texts[f.text]
    for _, begin in ipairs(told.begins) do is = is or sub(f.text, 1, #begin) == begin end
    if is and told_of(state, f.id).model ~= m then return with(state, f.id, "model", m) end
  end
  return state
end

---------------------------------------------------------------------------------------------- wCK

function describe.wck(spec, raw, kind)
  local n = #raw
  if sub(raw, 1, #spec.controller) == spec.controller and n > #spec.controller + 6 then
    local type = byte(raw, #spec.controller + 1)
    local sum = FOLDS.xor8(raw, #spec.controller + 7, n - 1)
    return {kind = kind, op = spec.types[type] or format("rbc_%02x", type), sum = {sum, byte(raw, n)},
      asks = kind == 0}
  end
  if kind == 1 then return n == 2 and {kind = 1, bare = true} or nil end
  if n < 4 then return nil end
  local data1, data2 = byte(raw, 2, 3)
  local op
  for _, one in ipairs(spec.by_first[data1] or {}) do
    if one.seconds[data2] then op = one; break end
  end
  if not op or byte(raw, 1) ~= spec.header or n < op.least then return nil end
  if op.most and n > op.most then return nil end
  local f = {kind = 0, command = op, op = op.name, asks = op.reply}
  if op.unknown then f.op = format("unknown_%02x", data2) end
  f.id_at, f.op_at = not op.nobody and (op.id_at or 1) or nil, 2
  if op.id_at then f.id = byte(raw, op.id_at + 1) elseif not op.nobody then f.id = data1 % 32 end
  f.alt = op.nobody or nil
  f.sum = {FOLDS.xor7(raw, op.sum_from + 1, n - 1), byte(raw, n)}
  if op.text_sum and f.sum[1] ~= f.sum[2] then  -- the section and note 5 of the manual differ
    local without = bxor(f.sum[1], byte(raw, 4) % 128)
    if without == f.sum[2] then f.sum[1] = without end
  end
  return f
end

local function ten_bits(state, h3, l7)  -- where L7 stands in its byte only the bus tells
  local right = state.low and not state.high
  return (h3 % 8) * 128 + (right and l7 % 128 or floor(l7 / 2))
end

-- Whether a 10-bit position has shown its lowest or its highest bit.
local function shown(state, reads, raw)
  for _, one in ipairs(reads) do
    if one.ten then
      local l7 = byte(raw, one.at + 2) or 0
      local low, high = state.low or l7 % 2 == 1, state.high or l7 > 127
      if low ~= state.low or high ~= state.high then
        state = {servos = state.servos, low = low, high = high}
      end
    end
  end
  return state
end

local function reads_of(spec, f, raw)
  if f.kind == 1 then
    return f.asked and f.asked.command and f.asked.command.back or {}
  end
  return f.command and (f.command.counted and f.command.counted[#raw - 4] or f.command.out) or {}
end

function values_in.wck(spec, state, f, raw)
  local out, registers = {}, spec.models[1].registers
  for _, one in ipairs(reads_of(spec, f, raw)) do
    local v = byte(raw, one.at + 1)
    if not v then break end
    if one.ten then v = ten_bits(state, v, byte(raw, one.at + 2))
    else v = bits_of(v, one.shift or 0, one.mask or 255) end
    out[#out + 1] = {one.servo or f.id, registers[one.reg], one.at, one.ten and 2 or 1, v}
  end
  return out
end

for _, spec in pairs(PROTOCOLS) do  -- tables that would be long to write out
  if spec.words then
    spec.registers = {}
    for _, model in ipairs(spec.models) do
      for _, reg in ipairs(model.registers) do table.insert(spec.registers, reg) end
    end
  end
  if spec.ops then
    spec.by_first = {}
    local function each(ranges, put)
      for i = 1, #ranges, 2 do for k = ranges[i], ranges[i + 1] do put(k) end end
    end
    for _, op in ipairs(spec.ops) do
      local seconds = {}
      each(op.seconds, function(k) seconds[k] = true end)
      op.seconds = seconds
      each(op.firsts, function(k)
        spec.by_first[k] = spec.by_first[k] or {}
        table.insert(spec.by_first[k], op)
      end)
    end
  end
end

------------------------------------------------------------------------------------------- pairing

-- The rules are the decoder's: what both carry must agree, servo and token (the key); of requests
-- and answers of one key the last requests have the first answers, so that the answer of a retry is
-- the retry's. A silence, `reach` bytes or sixteen other requests close a request.

local DEPTH = 16
local seen, buses  -- by frame number; by bus

function P.init() seen, buses = {}, {} end

local function new_bus()
  return {state = {servos = {}}, offset = 0, asked = 0, open = {}, runs = {}, row = {}}
end

local function bind(request, answer, outcome)
  if answer.request and answer.request.answer == answer then answer.request.answer = nil end
  local before = request and request.answer
  if before and before ~= answer and before.outcome == "mismatched" then  -- it was none after all
    before.request, before.outcome = nil, "unsolicited"
  end
  answer.request, answer.outcome = request, outcome
  if request then request.answer = answer end
end

local function is_open(spec, q, r)
  return r.start - q.stop <= spec.reach and r.asked - q.asked < DEPTH
end

local function names(q, id) return id == q.frame.id or q.frame.alt == true or (id and q.frame.alt == id) end

local function fits(q, r)
  return names(q, r.frame.id) and (r.frame.token == nil or r.frame.token == q.frame.token)
end

local function key_of(id, token) return (id or "") .. "|" .. (token or "") end

local function enter(bus, q, key)  -- a request into the run of its key, in order
  local run = bus.runs[key]
  if not run or #run.answers > 0 then
    run = {requests = {}, answers = {}}
    bus.runs[key] = run
  end
  q.key = key
  local at = #run.requests + 1
  while at > 1 and run.requests[at - 1].number > q.number do at = at - 1 end
  table.insert(run.requests, at, q)
end

local function ask(spec, bus, q)
  local f = q.frame
  bus.open[#bus.open + 1] = q
  if #bus.open > 4 * DEPTH then
    local kept = {}
    for i = #bus.open - 2 * DEPTH, #bus.open do kept[#kept + 1] = bus.open[i] end
    bus.open = kept
  end
  if f.many then
    for key in pairs(bus.runs) do
      if key:match("|(.*)$") == f.token then bus.runs[key] = nil end
    end
  elseif not f.alt then
    enter(bus, q, key_of(f.id, f.token))
  end
end

local function answer(spec, bus, r)
  local f, token = r.frame, r.frame.token
  for _, q in ipairs(bus.open) do  -- whose id may be another's takes it from its first answer
    if not q.key and not q.frame.many and fits(q, r) and is_open(spec, q, r) then
      enter(bus, q, key_of(f.id, q.frame.token))
    end
  end
  if token == nil then
    for i = #bus.open, 1, -1 do
      local q = bus.open[i]
      if q.frame.many then break end
      if names(q, f.id) and is_open(spec, q, r) then token = q.frame.token; break end
    end
  end
  local run = token ~= nil and bus.runs[key_of(f.id, token)]
  if run then
    table.insert(run.answers, r)
    local asked, n = run.requests, 0
    while n < math.min(#asked, #run.answers)
      and is_open(spec, asked[#asked - n], run.answers[n + 1]) do n = n + 1 end
    for _, q in ipairs(asked) do
      if q.answer and q.answer.outcome == "ok" then q.answer = nil end
    end
    for i = 1, n do bind(asked[#asked - n + i], run.answers[i], "ok") end
    if r.request then return end
  end
  for i = #bus.open, 1, -1 do
    local q = bus.open[i]
    if q.frame.many and fits(q, r) and is_open(spec, q, r) then
      r.request, r.outcome = q, "ok"
      q.answer = q.answer or r
      return
    end
  end
  local last = bus.last
  if last and last.frame.asks and is_open(spec, last, r) and (last.frame.many
    or (last.row == r.row - 1 and not last.answer)) then
    bind(last, r, "mismatched")
  else
    r.outcome = "unsolicited"
  end
end

-- Where answers name nobody: of m in a row the last m requests before them have one each.
local function in_order(bus, r)
  local row = bus.row
  table.insert(row.answers, r)
  for i, q in ipairs(row) do q.answer = nil end
  for i, one in ipairs(row.answers) do
    local q = row[#row - #row.answers + i]
    one.request, one.outcome = nil, "unsolicited"
    if q and q.frame.asks then bind(q, one, "ok") end
  end
end

local function refuses(spec, r)  -- an answer by which the servo says that it did not do it
  for _, mask in ipairs(r and r.outcome == "ok" and r.frame.status and spec.refusals or {}) do
    if has(r.frame.status, mask) then return true end
  end
  return false
end

-- What an answer is only with its request, which a later answer may still change.
local function ask_of(me, raw)
  local f, q = me.frame, me.request
  f.asked = me.outcome == "ok" and q and q.frame or nil
  if f.bare and q then
    f.id = q.frame.id
    if q.frame.command and q.frame.command.nobody then f.id = byte(raw, 1) end
  end
end

local function told(spec, bus, me, raw)  -- what this frame changes for those behind it
  local f = me.frame
  if f.kind == 1 then
    local q = me.request
    ask_of(me, raw)
    if q and q.before and refuses(spec, me) then bus.state = q.before end  -- it did not become so
    if not f.asked and not f.itself then me.state = bus.state; return end
    if spec.names then bus.state = named(spec, bus.state, f) end
  end
  if spec.ops then
    bus.state = shown(bus.state, reads_of(spec, f, raw), raw)
  elseif spec.watches then
    local before = bus.state
    local values = values_in[spec.style](spec, before, f, raw)
    bus.state = heard(spec, before, f, values)
    if bus.state == before then me.values = values else me.before = before end
    if f.resets then
      for _, name in ipairs(spec.watches) do bus.state = with(bus.state, f.id, name, nil) end
    end
  end
  me.state = bus.state
end

local function learn(spec, number, kind, raw, bus_number, begins, ends)
  local bus = buses[bus_number]
  if not bus or ends < (bus.ends or ends) - spec.tail then  -- time went back: another capture
    bus = new_bus()
    buses[bus_number] = bus
  end
  local me = {number = number, begins = begins, ends = ends, bus = bus}
  seen[number] = me
  if bus.ends and begins - bus.ends > spec.tail then
    bus.open, bus.runs, bus.row, bus.last = {}, {}, {}, nil
  end
  bus.ends = ends
  me.start, me.stop = bus.offset, bus.offset + #raw
  bus.offset = me.stop
  local found = describe[spec.style](spec, raw, kind % 2)
  if kind == 2 and not found then found = describe[spec.style](spec, raw, 1) end
  local is_bad = found and found.sum and found.sum[1] ~= found.sum[2]
  if is_bad then me.bad = found.sum end
  if kind < 2 and not is_bad then
    me.frame = found
  end
  if me.frame then
    bus.rows = (bus.rows or 0) + 1
    me.row = bus.rows
    if kind == 0 then
      if me.frame.asks then bus.asked = bus.asked + 1 end
      me.asked = bus.asked
      if spec.ordered then
        if not bus.row.answers or #bus.row.answers > 0 then bus.row = {answers = {}} end
        table.insert(bus.row, me)
      elseif me.frame.asks then ask(spec, bus, me) end
      bus.last = me
    else
      me.asked = bus.asked
      if spec.ordered then
        bus.row.answers = bus.row.answers or {}
        in_order(bus, me)
      else answer(spec, bus, me) end
    end
    told(spec, bus, me, raw)
  end
  return me
end

------------------------------------------------------------------------------------------ the tree

-- A capture without times says so of its interface: then what is between two stamps is no time.
-- Of one with times it says how far they may be late. Asked where there is a tree, and remembered
-- only once there is an answer: without a tree, and in a first pass, no field has a value.
local interface_field = Field.new("frame.interface_description")

local function clock_of(bus)
  local told = not bus.clock and interface_field()
  if told then
    local text = tostring(told)
    local _, at = text:find(WITHIN, 1, true)
    local late = at and tonumber(text:match("^[%d.]+", at + 1))
    bus.clock = {timed = not text:find(NO_TIMES, 1, true), unsure = late and late / 1e3}
  end
  return bus.clock or {timed = true}
end

local function in_micros(value) return floor(value * 1e6 + 0.5) / 1e6 end

local function show_value(state, tree, tvb, v, id)
  local servo, reg, at, width, raw = v[1], v[2], v[3], v[4], v[5]
  local range = tvb(at, width)
  local value = nil
  if not v[6] then value = value_of(state, servo, reg, raw) end
  local item
  if value then
    item = tree:add(reg.field, range, in_micros(value))
    if reg.unit then item:append_text(" " .. reg.unit) end
  else
    item = tree:add(F.register, range, reg.name)
    if v[6] then item:append_text(", a part of it") end
  end
  local words = name_of(reg, raw)
  item:append_text(format(" (raw %d%s)", raw, words and not v[6] and (", " .. words) or ""))
  if servo and servo ~= id then item:add(F.target, range, servo) end
  if not value then item:add(F.raw, range, Int64.new(raw)) end
end

local function in_words(state, values, id)  -- for the column: what the frame says of registers
  local out = {}
  for i, v in ipairs(values) do
    if i > 6 then out[#out + 1] = "..."; break end
    local servo, reg, raw = v[1], v[2], v[5]
    local value = not v[6] and value_of(state, servo, reg, raw)
    local words = not v[6] and name_of(reg, raw)
    local said = words or (value and (format("%.6g", value) .. (reg.unit and " " .. reg.unit or "")))
    out[#out + 1] = (servo ~= id and servo and servo .. ": " or "") .. reg.name .. " "
      .. (said or format("raw %d", raw))
  end
  return table.concat(out, ", ")
end

local function show_sum(top, tvb, sum)
  if not sum then
    top:add(F.sum_status, 2):set_generated()
    return
  end
  local want, got = sum[1], sum[2]
  local item = top:add(F.checksum, tvb(tvb:len() - 1, 1))
  local bad = want ~= got
  item:append_text(bad and format(" [should be 0x%02x]", want) or " [correct]")
  item:add(F.sum_status, bad and 0 or 1):set_generated()
  if bad then
    item:add(F.sum_bad, true):set_generated()
    item:add_proto_expert_info(E_SUM)
  end
end

local function show_status(spec, top, tvb, f)
  local at = spec.status_at or 0
  local item = top:add(F.status, tvb(math.min(at, tvb:len() - 1), 1), f.status)
  if f.status == 0 then return end
  local said = spec.status[f.status]
  if spec.status_bits then
    for k = 0, 7 do
      if has(f.status, 2 ^ k) then
        item:add(F.status_name, tvb(at, 1), spec.status_bits[k] or ("bit" .. k))
      end
    end
  end
  if said then item:add(F.status_name, tvb(0, 1), said) end
  item:add_proto_expert_info(E_STATUS)
end

local function show(spec, me, tvb, tree, values, op, address)
  local f = me.frame
  local whole = tvb()
  local top = tree:add(P, whole, spec.title)
  top:add(F.protocol, spec.name):set_generated()
  top:add(F.kind, f and f.kind or 2):set_generated()
  if not f then
    top:add(F.data, whole)
    top:add_proto_expert_info(E_GAP)
    if me.bad then show_sum(top, tvb, me.bad) end
    return
  end
  if f.id then
    local item = top:add(F.id, f.id_at and tvb(f.id_at, f.id_width or 1) or whole, f.id)
    local model = spec.models[model_of(spec, me.state, f.id)]
    if #spec.models > 1 and #values > 0 then item:add(F.model, model.name):set_generated() end
  end
  top:add(F.op, f.op_at and tvb(f.op_at, f.op_width or 1) or whole, op)
  if f.status then show_status(spec, top, tvb, f) end
  if address then top:add(F.addr, whole, address) end
  if f.count then top:add(F.count, whole, f.count) end
  if f.text then top:add(F.text, tvb(f.at, f.width), f.text) end
  if f.data_length and f.data_length > 0 then top:add(F.data, tvb(f.data_at, f.data_length)) end
  for _, v in ipairs(values) do show_value(me.state, top, tvb, v, f.id) end
  show_sum(top, tvb, f.sum)
  if f.kind == 1 then
    top:add(F.outcome, me.outcome):set_generated()
    if me.outcome == "unsolicited" then top:add_proto_expert_info(E_UNASKED) end
  end
  if me.request then
    top:add(F.response_to, me.request.number):set_generated()
    local clock = clock_of(me.bus)
    if clock.timed then
      local took = in_micros(math.max(me.begins - me.request.ends, 0))  -- the head has no more
      local item = top:add(F.rtt, took):set_generated()
      if clock.unsure then item:add(F.rtt_unsure, clock.unsure):set_generated() end
    end
  end
  if me.answer then top:add(F.response_in, me.answer.number):set_generated() end
  if refuses(spec, me.answer) then top:add(F.refused, true):set_generated() end
end

local function dissect(spec, tvb, pinfo, tree, kind, bus_number, begins)
  local raw = tvb:raw()
  local number = pinfo.number
  local me = seen[number]
  if not me then
    me = learn(spec, number, kind, raw, bus_number, begins, pinfo.abs_ts)
  end
  local f = me.frame
  pinfo.cols.protocol = spec.name
  if not f then
    pinfo.cols.info = "no frame: " .. tvb:bytes():tohex(false, " ")
    if tree then show(spec, me, tvb, tree) end
    return
  end
  local q = me.request
  if f.kind == 1 then ask_of(me, raw) end
  local op, address = f.op, f.address
  if f.kind == 1 and q and (me.outcome == "ok" or not f.itself) then
    op, address = q.frame.op, address or q.frame.address
  end
  local values = me.values
  me.values = nil  -- of the first pass, where they were read already
  if not values then
    local is_told = f.kind == 0 or f.asked or f.itself
    values = is_told and values_in[spec.style](spec, me.state, f, raw) or {}
  end
  local who = f.id and ("servo " .. f.id) or "servos"
  if f.kind == 0 and f.id and spec.everyone[f.id] then who = "all servos" end
  pinfo.cols.src = f.kind == 0 and "controller" or who
  pinfo.cols.dst = f.kind == 0 and who or "controller"
  local said = #values > 0 and in_words(me.state, values, f.id) or f.text or ""
  if #values == 0 and f.count and address then said = format("address %d, %d bytes", address, f.count) end
  pinfo.cols.info = format("%s %s %s", f.kind == 0 and "request " or "response", op or "?", said)
  if tree then show(spec, me, tvb, tree, values, op, address) end
end

---------------------------------------------------------------------------------- which are ours

local HEAD = 12  -- bytes of the RTAC head: seconds, microseconds, event, control lines, footer
local TX = 1     -- event: data of the terminal equipment, which is the controller's

local encap = DissectorTable.get("wtap_encap")
local original = encap:get_dissector(wtap.RTAC_SERIAL)
local shim = Proto("servo_rtac", "Servo bus in RTAC serial")

function P.dissector(tvb, pinfo, tree)  -- "Decode as": nothing is known but the bytes
  return 0
end

function shim.dissector(tvb, pinfo, tree)
  local foot = tvb:len() > HEAD and tvb(10, 2):uint() or 0
  local spec = PROTOCOLS[foot % 16]
  if floor(foot / 4096) ~= 5 or not spec then return original:call(tvb, pinfo, tree) end
  if tree then original:call(tvb(0, HEAD):tvb(), pinfo, tree) end
  local begins = tvb(0, 4):uint() + tvb(4, 4):uint() * 1e-6
  local kind = pinfo.p2p_dir == 0 and 0 or pinfo.p2p_dir == 1 and 1 or 2
  dissect(spec, tvb(HEAD):tvb(), pinfo, tree, kind, foot % 4096, begins)
  return tvb:len()
end

encap:add(wtap.RTAC_SERIAL, shim)
