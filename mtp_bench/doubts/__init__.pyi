from .examination import Examination as Examination, examine as examine
from .kinds import (
    DOCTOR_VERSION as DOCTOR_VERSION,
    Doubt as Doubt,
    kinds as kinds,
    limit_of as limit_of,
)
