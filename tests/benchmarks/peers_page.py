from pathlib import Path
RESULTS=Path('x')
def write(): ...
def tables_text(s): 
    import json
    return json.dumps(s,indent=0)[:6000]
