from npend_gym.report.campaign_report import analysis_text as analysis_text
from npend_gym.report.campaign_report import write_analysis as write_analysis
from npend_gym.report.identification_report import identification_text as identification_text
from npend_gym.report.identification_report import write_identification as write_identification
from npend_gym.report.outputs import write_csv as write_csv
from npend_gym.report.style import panels as panels
from npend_gym.report.style import styled as styled
