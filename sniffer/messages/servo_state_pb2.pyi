from sniffer.messages import recording_pb2 as _recording_pb2
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ServoState(_message.Message):
    __slots__ = ("offset", "kind", "response_time_ns", "response_time_ms", "position", "position_deg", "position_mm", "position_us", "goal_position", "goal_position_deg", "goal_position_mm", "goal_position_us", "speed", "speed_deg_per_s", "goal_speed", "goal_speed_deg_per_s", "load", "load_percent", "current_ma", "goal_current_ma", "voltage_v", "temperature_degc", "torque_enable", "moving", "force_limit", "torque_limit", "torque_limit_percent", "operating_rate", "goal_time_s", "elapsed_time_s", "status", "speed_us_per_s", "goal_speed_us_per_s")
    class Torque(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        OFF: _ClassVar[ServoState.Torque]
        ON: _ClassVar[ServoState.Torque]
        BRAKE: _ClassVar[ServoState.Torque]
    OFF: ServoState.Torque
    ON: ServoState.Torque
    BRAKE: ServoState.Torque
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_TIME_MS_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    POSITION_DEG_FIELD_NUMBER: _ClassVar[int]
    POSITION_MM_FIELD_NUMBER: _ClassVar[int]
    POSITION_US_FIELD_NUMBER: _ClassVar[int]
    GOAL_POSITION_FIELD_NUMBER: _ClassVar[int]
    GOAL_POSITION_DEG_FIELD_NUMBER: _ClassVar[int]
    GOAL_POSITION_MM_FIELD_NUMBER: _ClassVar[int]
    GOAL_POSITION_US_FIELD_NUMBER: _ClassVar[int]
    SPEED_FIELD_NUMBER: _ClassVar[int]
    SPEED_DEG_PER_S_FIELD_NUMBER: _ClassVar[int]
    GOAL_SPEED_FIELD_NUMBER: _ClassVar[int]
    GOAL_SPEED_DEG_PER_S_FIELD_NUMBER: _ClassVar[int]
    LOAD_FIELD_NUMBER: _ClassVar[int]
    LOAD_PERCENT_FIELD_NUMBER: _ClassVar[int]
    CURRENT_MA_FIELD_NUMBER: _ClassVar[int]
    GOAL_CURRENT_MA_FIELD_NUMBER: _ClassVar[int]
    VOLTAGE_V_FIELD_NUMBER: _ClassVar[int]
    TEMPERATURE_DEGC_FIELD_NUMBER: _ClassVar[int]
    TORQUE_ENABLE_FIELD_NUMBER: _ClassVar[int]
    MOVING_FIELD_NUMBER: _ClassVar[int]
    FORCE_LIMIT_FIELD_NUMBER: _ClassVar[int]
    TORQUE_LIMIT_FIELD_NUMBER: _ClassVar[int]
    TORQUE_LIMIT_PERCENT_FIELD_NUMBER: _ClassVar[int]
    OPERATING_RATE_FIELD_NUMBER: _ClassVar[int]
    GOAL_TIME_S_FIELD_NUMBER: _ClassVar[int]
    ELAPSED_TIME_S_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    SPEED_US_PER_S_FIELD_NUMBER: _ClassVar[int]
    GOAL_SPEED_US_PER_S_FIELD_NUMBER: _ClassVar[int]
    offset: int
    kind: _recording_pb2.Kind
    response_time_ns: int
    response_time_ms: float
    position: float
    position_deg: float
    position_mm: float
    position_us: float
    goal_position: float
    goal_position_deg: float
    goal_position_mm: float
    goal_position_us: float
    speed: float
    speed_deg_per_s: float
    goal_speed: float
    goal_speed_deg_per_s: float
    load: float
    load_percent: float
    current_ma: float
    goal_current_ma: float
    voltage_v: float
    temperature_degc: float
    torque_enable: ServoState.Torque
    moving: bool
    force_limit: float
    torque_limit: float
    torque_limit_percent: float
    operating_rate: float
    goal_time_s: float
    elapsed_time_s: float
    status: float
    speed_us_per_s: float
    goal_speed_us_per_s: float
    def __init__(self, offset: _Optional[int] = ..., kind: _Optional[_Union[_recording_pb2.Kind, str]] = ..., response_time_ns: _Optional[int] = ..., response_time_ms: _Optional[float] = ..., position: _Optional[float] = ..., position_deg: _Optional[float] = ..., position_mm: _Optional[float] = ..., position_us: _Optional[float] = ..., goal_position: _Optional[float] = ..., goal_position_deg: _Optional[float] = ..., goal_position_mm: _Optional[float] = ..., goal_position_us: _Optional[float] = ..., speed: _Optional[float] = ..., speed_deg_per_s: _Optional[float] = ..., goal_speed: _Optional[float] = ..., goal_speed_deg_per_s: _Optional[float] = ..., load: _Optional[float] = ..., load_percent: _Optional[float] = ..., current_ma: _Optional[float] = ..., goal_current_ma: _Optional[float] = ..., voltage_v: _Optional[float] = ..., temperature_degc: _Optional[float] = ..., torque_enable: _Optional[_Union[ServoState.Torque, str]] = ..., moving: bool = ..., force_limit: _Optional[float] = ..., torque_limit: _Optional[float] = ..., torque_limit_percent: _Optional[float] = ..., operating_rate: _Optional[float] = ..., goal_time_s: _Optional[float] = ..., elapsed_time_s: _Optional[float] = ..., status: _Optional[float] = ..., speed_us_per_s: _Optional[float] = ..., goal_speed_us_per_s: _Optional[float] = ...) -> None: ...

class Quantity(_message.Message):
    __slots__ = ("value",)
    VALUE_FIELD_NUMBER: _ClassVar[int]
    value: float
    def __init__(self, value: _Optional[float] = ...) -> None: ...
