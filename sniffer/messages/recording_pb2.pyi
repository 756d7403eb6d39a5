from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Clock(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CLOCK_NONE: _ClassVar[Clock]
    CLOCK_FILE: _ClassVar[Clock]
    CLOCK_READ: _ClassVar[Clock]
    CLOCK_SAMPLE: _ClassVar[Clock]

class Direction(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DIRECTION_UNKNOWN: _ClassVar[Direction]
    DIRECTION_TX: _ClassVar[Direction]
    DIRECTION_RX: _ClassVar[Direction]

class Kind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    REQUEST: _ClassVar[Kind]
    RESPONSE: _ClassVar[Kind]
CLOCK_NONE: Clock
CLOCK_FILE: Clock
CLOCK_READ: Clock
CLOCK_SAMPLE: Clock
DIRECTION_UNKNOWN: Direction
DIRECTION_TX: Direction
DIRECTION_RX: Direction
REQUEST: Kind
RESPONSE: Kind

class Mark(_message.Message):
    __slots__ = ("kind", "start", "length", "count")
    class Kind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        UNKNOWN: _ClassVar[Mark.Kind]
        FRAMING: _ClassVar[Mark.Kind]
        PARITY: _ClassVar[Mark.Kind]
        BREAK: _ClassVar[Mark.Kind]
        OVERRUN: _ClassVar[Mark.Kind]
        LOST: _ClassVar[Mark.Kind]
        BACK: _ClassVar[Mark.Kind]
        REORDERED: _ClassVar[Mark.Kind]
        SKIPPED: _ClassVar[Mark.Kind]
        ENDED: _ClassVar[Mark.Kind]
        HELD: _ClassVar[Mark.Kind]
        MERGED: _ClassVar[Mark.Kind]
        SILENT: _ClassVar[Mark.Kind]
        TUNED: _ClassVar[Mark.Kind]
        SENT: _ClassVar[Mark.Kind]
        COARSE: _ClassVar[Mark.Kind]
    UNKNOWN: Mark.Kind
    FRAMING: Mark.Kind
    PARITY: Mark.Kind
    BREAK: Mark.Kind
    OVERRUN: Mark.Kind
    LOST: Mark.Kind
    BACK: Mark.Kind
    REORDERED: Mark.Kind
    SKIPPED: Mark.Kind
    ENDED: Mark.Kind
    HELD: Mark.Kind
    MERGED: Mark.Kind
    SILENT: Mark.Kind
    TUNED: Mark.Kind
    SENT: Mark.Kind
    COARSE: Mark.Kind
    KIND_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    kind: Mark.Kind
    start: int
    length: int
    count: int
    def __init__(self, kind: _Optional[_Union[Mark.Kind, str]] = ..., start: _Optional[int] = ..., length: _Optional[int] = ..., count: _Optional[int] = ...) -> None: ...

class RawChunk(_message.Message):
    __slots__ = ("t_ns", "clock", "direction", "offset", "data", "marks")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    CLOCK_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    MARKS_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    clock: Clock
    direction: Direction
    offset: int
    data: bytes
    marks: _containers.RepeatedCompositeFieldContainer[Mark]
    def __init__(self, t_ns: _Optional[int] = ..., clock: _Optional[_Union[Clock, str]] = ..., direction: _Optional[_Union[Direction, str]] = ..., offset: _Optional[int] = ..., data: _Optional[bytes] = ..., marks: _Optional[_Iterable[_Union[Mark, _Mapping]]] = ...) -> None: ...

class Frame(_message.Message):
    __slots__ = ("t_start_ns", "t_end_ns", "uncertainty_ns", "offset", "length", "kind", "servo_id", "op", "op_code", "address", "status", "flags", "direction", "data")
    T_START_NS_FIELD_NUMBER: _ClassVar[int]
    T_END_NS_FIELD_NUMBER: _ClassVar[int]
    UNCERTAINTY_NS_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    SERVO_ID_FIELD_NUMBER: _ClassVar[int]
    OP_FIELD_NUMBER: _ClassVar[int]
    OP_CODE_FIELD_NUMBER: _ClassVar[int]
    ADDRESS_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    t_start_ns: int
    t_end_ns: int
    uncertainty_ns: int
    offset: int
    length: int
    kind: Kind
    servo_id: int
    op: str
    op_code: int
    address: int
    status: int
    flags: int
    direction: Direction
    data: bytes
    def __init__(self, t_start_ns: _Optional[int] = ..., t_end_ns: _Optional[int] = ..., uncertainty_ns: _Optional[int] = ..., offset: _Optional[int] = ..., length: _Optional[int] = ..., kind: _Optional[_Union[Kind, str]] = ..., servo_id: _Optional[int] = ..., op: _Optional[str] = ..., op_code: _Optional[int] = ..., address: _Optional[int] = ..., status: _Optional[int] = ..., flags: _Optional[int] = ..., direction: _Optional[_Union[Direction, str]] = ..., data: _Optional[bytes] = ...) -> None: ...

class Transaction(_message.Message):
    __slots__ = ("outcome", "request_offset", "response_offset", "servo_id", "op", "response_time_ns", "uncertainty_ns", "response_time_ms")
    class Outcome(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        OK: _ClassVar[Transaction.Outcome]
        NO_RESPONSE: _ClassVar[Transaction.Outcome]
        NOT_EXPECTED: _ClassVar[Transaction.Outcome]
        MISMATCHED: _ClassVar[Transaction.Outcome]
        UNSOLICITED: _ClassVar[Transaction.Outcome]
        DAMAGED: _ClassVar[Transaction.Outcome]
    OK: Transaction.Outcome
    NO_RESPONSE: Transaction.Outcome
    NOT_EXPECTED: Transaction.Outcome
    MISMATCHED: Transaction.Outcome
    UNSOLICITED: Transaction.Outcome
    DAMAGED: Transaction.Outcome
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    REQUEST_OFFSET_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_OFFSET_FIELD_NUMBER: _ClassVar[int]
    SERVO_ID_FIELD_NUMBER: _ClassVar[int]
    OP_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_TIME_NS_FIELD_NUMBER: _ClassVar[int]
    UNCERTAINTY_NS_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_TIME_MS_FIELD_NUMBER: _ClassVar[int]
    outcome: Transaction.Outcome
    request_offset: int
    response_offset: int
    servo_id: int
    op: str
    response_time_ns: int
    uncertainty_ns: int
    response_time_ms: float
    def __init__(self, outcome: _Optional[_Union[Transaction.Outcome, str]] = ..., request_offset: _Optional[int] = ..., response_offset: _Optional[int] = ..., servo_id: _Optional[int] = ..., op: _Optional[str] = ..., response_time_ns: _Optional[int] = ..., uncertainty_ns: _Optional[int] = ..., response_time_ms: _Optional[float] = ...) -> None: ...

class Gap(_message.Message):
    __slots__ = ("t_ns", "offset", "length", "reason", "detail", "data")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    offset: int
    length: int
    reason: str
    detail: str
    data: bytes
    def __init__(self, t_ns: _Optional[int] = ..., offset: _Optional[int] = ..., length: _Optional[int] = ..., reason: _Optional[str] = ..., detail: _Optional[str] = ..., data: _Optional[bytes] = ...) -> None: ...

class Anomaly(_message.Message):
    __slots__ = ("t_ns", "severity", "group", "code", "servo_id", "detail", "evidence")
    class Severity(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        NOTE: _ClassVar[Anomaly.Severity]
        WARN: _ClassVar[Anomaly.Severity]
        ERROR: _ClassVar[Anomaly.Severity]
    NOTE: Anomaly.Severity
    WARN: Anomaly.Severity
    ERROR: Anomaly.Severity
    class Evidence(_message.Message):
        __slots__ = ("offset", "length")
        OFFSET_FIELD_NUMBER: _ClassVar[int]
        LENGTH_FIELD_NUMBER: _ClassVar[int]
        offset: int
        length: int
        def __init__(self, offset: _Optional[int] = ..., length: _Optional[int] = ...) -> None: ...
    T_NS_FIELD_NUMBER: _ClassVar[int]
    SEVERITY_FIELD_NUMBER: _ClassVar[int]
    GROUP_FIELD_NUMBER: _ClassVar[int]
    CODE_FIELD_NUMBER: _ClassVar[int]
    SERVO_ID_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    EVIDENCE_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    severity: Anomaly.Severity
    group: str
    code: str
    servo_id: int
    detail: str
    evidence: _containers.RepeatedCompositeFieldContainer[Anomaly.Evidence]
    def __init__(self, t_ns: _Optional[int] = ..., severity: _Optional[_Union[Anomaly.Severity, str]] = ..., group: _Optional[str] = ..., code: _Optional[str] = ..., servo_id: _Optional[int] = ..., detail: _Optional[str] = ..., evidence: _Optional[_Iterable[_Union[Anomaly.Evidence, _Mapping]]] = ...) -> None: ...

class Incident(_message.Message):
    __slots__ = ("t_ns", "stage", "id", "severity", "bus", "servo_ids", "first_t_ns", "last_t_ns", "count", "story", "causes", "findings", "evidence", "against", "next")
    class Stage(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        OPENED: _ClassVar[Incident.Stage]
        CHANGED: _ClassVar[Incident.Stage]
        OVER: _ClassVar[Incident.Stage]
        WITHDRAWN: _ClassVar[Incident.Stage]
        ENDED: _ClassVar[Incident.Stage]
    OPENED: Incident.Stage
    CHANGED: Incident.Stage
    OVER: Incident.Stage
    WITHDRAWN: Incident.Stage
    ENDED: Incident.Stage
    class Cause(_message.Message):
        __slots__ = ("cause", "confidence", "why")
        CAUSE_FIELD_NUMBER: _ClassVar[int]
        CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
        WHY_FIELD_NUMBER: _ClassVar[int]
        cause: str
        confidence: float
        why: str
        def __init__(self, cause: _Optional[str] = ..., confidence: _Optional[float] = ..., why: _Optional[str] = ...) -> None: ...
    class Finding(_message.Message):
        __slots__ = ("code", "count", "servo_id", "first_t_ns", "last_t_ns", "what")
        CODE_FIELD_NUMBER: _ClassVar[int]
        COUNT_FIELD_NUMBER: _ClassVar[int]
        SERVO_ID_FIELD_NUMBER: _ClassVar[int]
        FIRST_T_NS_FIELD_NUMBER: _ClassVar[int]
        LAST_T_NS_FIELD_NUMBER: _ClassVar[int]
        WHAT_FIELD_NUMBER: _ClassVar[int]
        code: str
        count: int
        servo_id: int
        first_t_ns: int
        last_t_ns: int
        what: str
        def __init__(self, code: _Optional[str] = ..., count: _Optional[int] = ..., servo_id: _Optional[int] = ..., first_t_ns: _Optional[int] = ..., last_t_ns: _Optional[int] = ..., what: _Optional[str] = ...) -> None: ...
    class Evidence(_message.Message):
        __slots__ = ("offset", "length", "t_ns", "what")
        OFFSET_FIELD_NUMBER: _ClassVar[int]
        LENGTH_FIELD_NUMBER: _ClassVar[int]
        T_NS_FIELD_NUMBER: _ClassVar[int]
        WHAT_FIELD_NUMBER: _ClassVar[int]
        offset: int
        length: int
        t_ns: int
        what: str
        def __init__(self, offset: _Optional[int] = ..., length: _Optional[int] = ..., t_ns: _Optional[int] = ..., what: _Optional[str] = ...) -> None: ...
    T_NS_FIELD_NUMBER: _ClassVar[int]
    STAGE_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    SEVERITY_FIELD_NUMBER: _ClassVar[int]
    BUS_FIELD_NUMBER: _ClassVar[int]
    SERVO_IDS_FIELD_NUMBER: _ClassVar[int]
    FIRST_T_NS_FIELD_NUMBER: _ClassVar[int]
    LAST_T_NS_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    STORY_FIELD_NUMBER: _ClassVar[int]
    CAUSES_FIELD_NUMBER: _ClassVar[int]
    FINDINGS_FIELD_NUMBER: _ClassVar[int]
    EVIDENCE_FIELD_NUMBER: _ClassVar[int]
    AGAINST_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    stage: Incident.Stage
    id: str
    severity: Anomaly.Severity
    bus: str
    servo_ids: _containers.RepeatedScalarFieldContainer[int]
    first_t_ns: int
    last_t_ns: int
    count: int
    story: str
    causes: _containers.RepeatedCompositeFieldContainer[Incident.Cause]
    findings: _containers.RepeatedCompositeFieldContainer[Incident.Finding]
    evidence: _containers.RepeatedCompositeFieldContainer[Incident.Evidence]
    against: str
    next: str
    def __init__(self, t_ns: _Optional[int] = ..., stage: _Optional[_Union[Incident.Stage, str]] = ..., id: _Optional[str] = ..., severity: _Optional[_Union[Anomaly.Severity, str]] = ..., bus: _Optional[str] = ..., servo_ids: _Optional[_Iterable[int]] = ..., first_t_ns: _Optional[int] = ..., last_t_ns: _Optional[int] = ..., count: _Optional[int] = ..., story: _Optional[str] = ..., causes: _Optional[_Iterable[_Union[Incident.Cause, _Mapping]]] = ..., findings: _Optional[_Iterable[_Union[Incident.Finding, _Mapping]]] = ..., evidence: _Optional[_Iterable[_Union[Incident.Evidence, _Mapping]]] = ..., against: _Optional[str] = ..., next: _Optional[str] = ...) -> None: ...

class Stats(_message.Message):
    __slots__ = ("t_ns", "bytes", "frames", "gaps", "anomalies", "bus_load_percent")
    T_NS_FIELD_NUMBER: _ClassVar[int]
    BYTES_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    GAPS_FIELD_NUMBER: _ClassVar[int]
    ANOMALIES_FIELD_NUMBER: _ClassVar[int]
    BUS_LOAD_PERCENT_FIELD_NUMBER: _ClassVar[int]
    t_ns: int
    bytes: int
    frames: int
    gaps: int
    anomalies: int
    bus_load_percent: float
    def __init__(self, t_ns: _Optional[int] = ..., bytes: _Optional[int] = ..., frames: _Optional[int] = ..., gaps: _Optional[int] = ..., anomalies: _Optional[int] = ..., bus_load_percent: _Optional[float] = ...) -> None: ...
